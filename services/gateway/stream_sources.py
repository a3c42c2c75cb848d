"""What the event streams read: a log under a lock, to which any thread adds, and which wakes the streams.

``BuildingEvents`` has what happened, ``LiveStates`` how everything is now. Small pictures of cameras are in ``tiles.py``.
"""

from __future__ import annotations

import asyncio
import threading
import uuid
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager

from pydantic import BaseModel

from surveilnav.bus import Node
from surveilnav.services.gateway.core.change_log import EventLog, LogEntry, ReadPosition, StateLog
from surveilnav.services.gateway.core.problems import Problem

#: Each stream costs a connection, and at most what uvicorn and the kernel buffer for it.
_MAX_STREAMS = 200
#: How often the state of everything is compared with what was sent.
_COMPARE_PERIOD_S = 0.5
#: Resources by id.
Resources = Mapping[str, BaseModel]


class StreamSource:
    """A log that event streams read at their own pace, and the streams that wait for news in it.

    Attributes:
        beat_s: a stream sends its position again when there was nothing to send for this time. So both ends, and proxies
            between them, notice when the connection is dead.
        beat_event: the name of the event that is sent with it; "" for none, so that clients don't notice.
        ended: whether the gateway is about to stop, so that streams have to end.
    """

    beat_s = 15.0
    beat_event = ""

    def __init__(self, log: EventLog | StateLog) -> None:
        self._source = log
        self._lock = threading.Lock()
        self._wakers: dict[asyncio.Event, asyncio.AbstractEventLoop] = {}
        self.ended: Callable[[], bool] = lambda: False

    @property
    def n_streams(self) -> int:
        """How many streams are open."""
        return len(self._wakers)

    @property
    def newest(self) -> int:
        """How many changes the log has taken since the gateway started."""
        return self._source.newest

    @property
    def advice(self) -> str:
        """What a client should do that has to begin anew."""
        return self._source.advice

    def id_of(self, number: int) -> str:
        """The id of the entry with that number."""
        return self._source.id_of(number)

    def position(self, last_id: str | None) -> ReadPosition:
        """Where a client goes on whose last event had that id."""
        with self._lock:
            return self._source.position(last_id)

    def after(self, number: int, ids: Collection[str] | None = None) -> tuple[ReadPosition, list[LogEntry]]:
        """Where a client is that has the entries up to ``number``, and the next ones. ``ids``: as for the log."""
        with self._lock:
            position = self._source.checked(number)
            return position, self._source.after(position.number, ids)

    @contextmanager
    def waking(self) -> Iterator[asyncio.Event]:
        """An event of the running loop that is set whenever there is news.

        Raises:
            Problem: too many streams are open (503).
        """
        waker = asyncio.Event()
        with self._lock:
            if len(self._wakers) >= _MAX_STREAMS:
                detail = f"{_MAX_STREAMS} event streams are open, which is the most: close one and try again"
                raise Problem(503, "too_many_streams", detail)
            self._wakers[waker] = asyncio.get_running_loop()
        try:
            yield waker
        finally:
            with self._lock:
                del self._wakers[waker]

    def _wake(self) -> None:
        """Wakes the streams. The caller holds the lock."""
        for waker, loop in self._wakers.items():
            try:
                loop.call_soon_threadsafe(waker.set)
            except RuntimeError:  # its server has ended
                continue


class BuildingEvents(StreamSource):
    """The newest ``capacity`` events of the building. A stream that can't go on after its last event gets a `reset`."""

    def __init__(self, capacity: int = 10_000) -> None:
        self._log = EventLog(uuid.uuid4().hex[:8], capacity)
        super().__init__(self._log)

    def publish(self, kind: str, data: str) -> None:
        """Adds an event (``data``: JSON on one line) and wakes the streams."""
        with self._lock:
            self._log.append(kind, data)
            self._wake()


class LiveStates(StreamSource):
    """The present state of all resources. While anybody watches, a thread compares them with what was sent, once for all.

    ``readers`` gives for each kind all resources of it. A resource is sent again if anything but its ``last_seen`` changed.
    """

    beat_s = 5.0
    beat_event = "beat"

    def __init__(self, node: Node, readers: Mapping[str, Callable[[], Resources]]) -> None:
        self._log = StateLog(uuid.uuid4().hex[:8])
        super().__init__(self._log)
        self._node, self._readers = node, readers
        #: The resource, and its JSON without ``last_seen``, by kind and id.
        self._sent: dict[str, dict[str, tuple[BaseModel, str]]] = {kind: {} for kind in readers}
        threading.Thread(target=self._run, name="live", daemon=True).start()

    def _run(self) -> None:
        while not self._node.stopping.wait(_COMPARE_PERIOD_S):
            for kind, read in self._readers.items() if self.n_streams else ():
                try:
                    self._update(kind, read())
                except Exception:  # a bug must not freeze in silence what people see
                    if not self._node.stopping.is_set():
                        self._node.log.exception("can't show what is there", kind=kind)

    def _update(self, kind: str, resources: Resources) -> None:
        """Puts what changed into the log; resources that aren't there any more are gone."""
        sent = self._sent[kind]
        gone = sent.keys() - resources.keys()
        changed: dict[str, str | None] = dict.fromkeys(gone)
        for id, resource in resources.items():
            known = sent.get(id)
            if known is not None and known[0] is resource:
                continue
            timeless = resource.model_dump_json(exclude={"last_seen"})
            if known is None or known[1] != timeless:
                changed[id] = resource.model_dump_json()
            sent[id] = resource, timeless
        for id in gone:
            del sent[id]
        if changed:
            with self._lock:
                for id, state in changed.items():
                    self._log.update(kind, id, state)
                self._wake()
