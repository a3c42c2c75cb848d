"""Searches with cameras alone: while one is open, the cameras of its floors are invoked as if a robot were there."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator
from contextlib import contextmanager


class CameraSearches:
    """The open searches. Safe from any thread."""

    def __init__(self) -> None:
        self._open: dict[int, tuple[str, str | None]] = {}
        self._numbers = itertools.count()
        self._lock = threading.Lock()

    @contextmanager
    def open(self, target: str, floor: str | None) -> Iterator[None]:
        """Keeps a search for ``target`` open until the block ends. ``floor`` None: on all floors."""
        number = next(self._numbers)
        with self._lock:
            self._open[number] = target, floor
        try:
            yield
        finally:
            with self._lock:
                del self._open[number]

    def targets(self) -> list[str]:
        """What is searched for."""
        with self._lock:
            return [target for target, _ in self._open.values()]

    def includes(self, floor: str) -> bool:
        """Whether a floor is searched."""
        with self._lock:
            return any(wanted in (None, floor) for _, wanted in self._open.values())
