"""Logging set-up (for people, or as JSON), and a rate limiter for events that hostile data could cause any number of times."""

from __future__ import annotations

import io
import logging
import math
import sys
import threading
import time
from typing import Any, TextIO, cast

import structlog

from surveilnav.bus.correlation import add_request_id


def configure(log_format: str = "console", level: str = "info") -> None:
    """Sets up structlog for this process. Logs go to stderr, because results go to stdout."""
    renderer: Any
    if log_format == "json":
        renderer = structlog.processors.JSONRenderer()
    else:
        renderer = structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty())
    structlog.configure(
        processors=[
            add_request_id,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(logging.getLevelName(level.upper())),
        logger_factory=structlog.PrintLoggerFactory(cast(TextIO, _CurrentStderr())),
        cache_logger_on_first_use=True,
    )


class _CurrentStderr(io.TextIOBase):
    """Writes to what ``sys.stderr`` is at that moment: who redirects it for a while must not be left with loggers that keep
    writing to a file that is closed by then."""

    def write(self, text: str) -> int:
        return sys.stderr.write(text)

    def flush(self) -> None:
        sys.stderr.flush()


class RateLimiter:
    """Allows one event per ``period_s`` for each key. Remembers ``capacity`` keys. Thread-safe."""

    def __init__(self, period_s: float = 5.0, capacity: int = 1000) -> None:
        self._period_s, self._capacity = period_s, capacity
        self._last: dict[str, float] = {}
        self._lock = threading.Lock()

    def try_acquire(self, key: str) -> bool:
        """Whether an event of this key is allowed now. If so, the next ones are refused for ``period_s``."""
        now = time.monotonic()
        with self._lock:
            if now - self._last.get(key, -math.inf) < self._period_s:
                return False
            if len(self._last) >= self._capacity:
                self._last.clear()
            self._last[key] = now
            return True
