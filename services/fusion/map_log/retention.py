"""When pictures in the log are too old. A picture leaves it with the second snapshot of the maps after it (``store``)."""

from __future__ import annotations

_REST_S = 30.0


class LogAge:
    """Says when a snapshot is due so that no picture stays longer than ``keep_s``; None: as long as others make them due.

    Every call is told the time [s] of a clock that only goes forth.
    """

    def __init__(self, keep_s: float | None) -> None:
        self._keep_s = keep_s
        self._new_s: float | None = None  # since when there are views that no snapshot holds
        self._old_s: float | None = None  # since when there are views that the newest snapshot made superfluous
        self._wanted, self._rests_until_s = 0, 0.0

    def forget(self) -> None:
        """Everything that is in the log now shall go."""
        self._wanted, self._rests_until_s = 2, 0.0

    def logged(self, now_s: float) -> None:
        """A view went into the log."""
        self._new_s = now_s if self._new_s is None else self._new_s

    def saved(self, now_s: float) -> bool:
        """A snapshot is being saved; True if all that was to be forgotten goes with it."""
        self._old_s, self._new_s = (now_s if self._new_s is not None else None), None
        self._wanted -= self._wanted > 0
        return self._wanted == 0

    def failed(self, now_s: float) -> None:
        """It couldn't be saved: the log is as it was."""
        if self._keep_s is not None or self._wanted:
            self._wanted, self._rests_until_s = 2, now_s + _REST_S

    def is_due(self, now_s: float) -> bool:
        """Whether a snapshot must be saved for the pictures' sake."""
        if now_s < self._rests_until_s:
            return False
        if self._wanted:
            return True
        marks = [mark for mark in (self._new_s, self._old_s) if mark is not None]
        return self._keep_s is not None and any(now_s - mark >= self._keep_s / 2 for mark in marks)
