"""Logs: one line an event, for people or as JSON, and a limiter for what hostile data could cause a million times."""

from __future__ import annotations

import logging
import sys
import threading
import time
from typing import Any

import structlog


def configure(log_format: str = "console", level: str = "info") -> None:
    """Sets up structlog for this process; everything goes to stderr (stdout belongs to results)."""
    renderer: Any
    if log_format == "json":
        renderer = structlog.processors.JSONRenderer()
    else:
        renderer = structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty())
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(logging.getLevelName(level.upper())),
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
        cache_logger_on_first_use=True,
    )


class RateLimiter:
    """Lets through one event per ``period_s`` and key."""

    def __init__(self, period_s: float = 5.0, capacity: int = 1000) -> None:
        self._period_s, self._capacity = period_s, capacity
        self._last: dict[str, float] = {}
        self._lock = threading.Lock()

    def try_acquire(self, key: str) -> bool:
        """Whether this event goes through; if so, the next ones of its key wait."""
        now = time.monotonic()
        with self._lock:
            if now - self._last.get(key, -1e9) < self._period_s:
                return False
            if len(self._last) >= self._capacity:
                self._last.clear()
            self._last[key] = now
            return True
