"""The log of events: what happened in the building, for streams that miss nothing."""

from __future__ import annotations

import uuid

from surveilnav.services.gateway.core.event_log import EventLog
from surveilnav.services.gateway.feed import Feed


class Events(Feed):
    """Takes events from any thread, and wakes the streams."""

    def __init__(self, capacity: int = 10_000) -> None:
        self._log = EventLog(uuid.uuid4().hex[:8], capacity)
        super().__init__(self._log)

    def publish(self, kind: str, data: str) -> None:
        """Keeps an event (``data``: JSON on one line) and wakes the streams."""
        with self._lock:
            self._log.append(kind, data)
            self._wake()
