"""What streams tell, shared by who hears of it on any thread and by the streams themselves."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager

from surveilnav.services.gateway.core.board import Board
from surveilnav.services.gateway.core.event_log import Event, EventLog, Position
from surveilnav.services.gateway.core.problems import Problem

#: Each stream costs a connection, and at most what uvicorn and the kernel buffer for it.
_MAX_STREAMS = 200


class Feed:
    """What happened (a log) or how things are (a board), under a lock, and the streams that wait for news of it.

    Attributes:
        beat_s: so often the present id is sent where nothing happens: who is gone, or what stands between, is noticed.
        beat: what is sent with it, if clients shall notice, too.
        ended: whether the gateway is about to stop, so that streams end.
        advice: what a client does that is told to begin anew.
        streams: how many are open.
    """

    beat_s = 15.0
    beat = ""

    def __init__(self, source: EventLog | Board) -> None:
        self._source, self.advice = source, source.advice
        self._lock = threading.Lock()
        self._wakers: dict[asyncio.Event, asyncio.AbstractEventLoop] = {}
        self.ended: Callable[[], bool] = lambda: False

    @property
    def streams(self) -> int:
        return len(self._wakers)

    @property
    def newest(self) -> int:
        """How many changes it took since the gateway started."""
        return self._source.newest

    def _wake(self) -> None:
        """Wakes the streams; the lock is held."""
        for waker, loop in self._wakers.items():
            try:
                loop.call_soon_threadsafe(waker.set)
            except RuntimeError:  # its server has ended
                continue

    def id_of(self, number: int) -> str:
        """The id of the event with that number."""
        return self._source.id_of(number)

    def position(self, last_id: str | None) -> Position:
        """Where a client goes on whose last event had that id."""
        with self._lock:
            return self._source.position(last_id)

    def after(self, number: int, ids: Collection[str] | None = None) -> tuple[Position, list[Event]]:
        """Where a client is that has events up to ``number``, and the next ones; on a board those of some ids alone."""
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
