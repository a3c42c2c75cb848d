"""Whether a mission is paused, and why."""

from __future__ import annotations

import threading


class PausedError(Exception):
    """The mission is paused: what was decided is kept for later."""


class Pause:
    """A pause that any thread may begin and end. ``reason`` None: the mission isn't paused."""

    def __init__(self, reason: str | None) -> None:
        self.reason = reason
        self._ended = threading.Event()

    def begin(self, reason: str) -> None:
        """Has the mission pause at its next turn."""
        self._ended.clear()
        self.reason = reason or "paused"

    def end(self) -> None:
        """Has it go on."""
        self.reason = None
        self._ended.set()

    def check(self) -> None:
        """PausedError: it is paused."""
        if self.reason is not None:
            raise PausedError(self.reason)

    def wait(self, at_most_s: float) -> None:
        """Until it ends, or so long."""
        self._ended.wait(at_most_s)
