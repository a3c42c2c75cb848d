"""The logs that event streams read. Any thread may add to a log, which then wakes the streams.

``BuildingEvents`` says what has happened, ``LiveStates`` the present state of everything. ``tiles.py`` has pictures of cameras.
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

#: Each stream takes a connection, and the memory of uvicorn's and the kernel's buffers for it.
_MAX_STREAMS = 200
#: How often the state of everything is compared with what was sent.
_COMPARE_PERIOD_S = 0.5
#: Resources by id.
Resources = Mapping[str, BaseModel]


class StreamSource:
    """A log that event streams read at their own pace, and the streams that wait for new entries.

    Attributes:
        beat_s: if a stream has had nothing to send for this time, it sends its position again. So both ends, and proxies
            between them, notice a dead connection.
        beat_event: the name of the event for that; "": no event, only an id, which browsers don't report to the page.
        ended: returns whether the gateway is about to stop, so that streams must end.
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
        return len(self._wakers)

    @property
    def newest(self) -> int:
        """The number of the newest entry, counted from the start of the gateway."""
        return self._source.newest

    @property
    def advice(self) -> str:
        """What a client should do if it can't continue from its last event. It is sent with ``reset``."""
        return self._source.advice

    def id_of(self, number: int) -> str:
        return self._source.id_of(number)

    def position(self, last_id: str | None) -> ReadPosition:
        """The position from which a client continues whose last event had the id ``last_id``."""
        with self._lock:
            return self._source.position(last_id)

    def after(self, number: int, ids: Collection[str] | None = None) -> tuple[ReadPosition, list[LogEntry]]:
        """The next entries for a client that has those up to ``number``, and its checked position. ``ids``: as for the log."""
        with self._lock:
            position = self._source.checked(number)
            return position, self._source.after(position.number, ids)

    @contextmanager
    def waking(self) -> Iterator[asyncio.Event]:
        """An asyncio event of the running loop that is set whenever the log has new entries.

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
    """The present state of all resources. While any stream is open, one thread compares it with what was last sent.

    ``readers``: for each kind, a function that returns all resources of that kind. A resource is sent again if anything but its
    ``last_seen`` has changed.
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
        """Adds the changed resources of a kind to the log. Those that are missing now are logged as gone."""
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
