"""The log of events, shared by who hears of them and by the streams that tell them."""

from __future__ import annotations

import asyncio
import threading
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from services.gateway.core.event_log import Event, EventLog, Position
from services.gateway.core.problems import Problem

#: Each stream costs a connection, and at most what uvicorn and the kernel buffer for it.
_MAX_STREAMS = 200


class Events:
    """Takes events from any thread, and wakes the streams.

    Attributes:
        ended: whether the gateway is about to stop, so that streams end.
        streams: how many are open.
    """

    def __init__(self, capacity: int = 10_000) -> None:
        self._log = EventLog(uuid.uuid4().hex[:8], capacity)
        self._lock = threading.Lock()
        self._wakers: dict[asyncio.Event, asyncio.AbstractEventLoop] = {}
        self.ended: Callable[[], bool] = lambda: False

    @property
    def streams(self) -> int:
        return len(self._wakers)

    @property
    def newest(self) -> int:
        """How many events there were since the gateway started."""
        return self._log.newest

    def publish(self, kind: str, data: str) -> None:
        """Keeps an event (``data``: JSON on one line) and wakes the streams."""
        with self._lock:
            self._log.append(kind, data)
            for waker, loop in self._wakers.items():
                try:
                    loop.call_soon_threadsafe(waker.set)
                except RuntimeError:  # its server has ended
                    continue

    def id_of(self, number: int) -> str:
        """The id of the event with that number."""
        return self._log.id_of(number)

    def position(self, last_id: str | None) -> Position:
        """Where a client goes on whose last event had that id."""
        with self._lock:
            return self._log.position(last_id)

    def after(self, number: int) -> tuple[Position, list[Event]]:
        """Where a client is that has events up to ``number``, and the next ones."""
        with self._lock:
            position = self._log.checked(number)
            return position, self._log.after(position.number)

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
