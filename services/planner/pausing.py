"""Pausing a mission."""

from __future__ import annotations

import threading
from collections.abc import Callable

from surveilnav.bus import Refused


class PausedError(Exception):
    """The mission is paused. What it decided last is carried out once it is resumed."""


class Pause:
    """Whether a mission is paused, and why. Any thread may begin and end the pause.

    Attributes:
        reason: why the mission is paused; None while it isn't paused.
        stored_reason: the same, but None if the pause ends by itself: after a restart the mission decides anew whether to wait.
    """

    def __init__(self, reason: str | None) -> None:
        self.reason = reason
        self._is_over: Callable[[], bool] | None = None
        self._ended, self._lock = threading.Event(), threading.Lock()

    def begin(self, reason: str, is_over: Callable[[], bool] | None = None) -> bool:
        """Pauses the mission as soon as its current action is done. ``is_over`` says when the pause ends by itself.

        Such a pause never takes the place of one that only a person ends. Returns whether it began.
        """
        with self._lock:
            if is_over is not None and self.reason is not None and self._is_over is None:
                return False
            self._ended.clear()
            self._is_over = is_over
            self.reason = reason or "paused"
            return True

    def end(self) -> bool:
        """Resumes the mission. Returns whether the pause would have ended by itself."""
        with self._lock:
            ended_itself = self._is_over is not None
            self.reason, self._is_over = None, None
            self._ended.set()
            return ended_itself

    @property
    def stored_reason(self) -> str | None:
        return self.reason if self._is_over is None else None

    def check(self) -> None:
        if self.reason is not None:
            raise PausedError(self.reason)

    def wait(self, at_most_s: float) -> None:
        """Waits until the pause ends, for at most ``at_most_s``."""
        is_over = self._is_over
        if is_over is not None and is_over():
            with self._lock:
                if self._is_over is is_over:  # no other pause has begun meanwhile
                    self.reason, self._is_over = None, None
                    self._ended.set()
        self._ended.wait(at_most_s)


class FramePause:
    """Pauses a mission once as its robot turns out not to be where it says. Whoever resumes it nevertheless is obeyed."""

    def __init__(self) -> None:
        self._told = False

    def reason(self, problem: str) -> str:
        """Why to pause now; empty: not. ``problem``: why the robot can't be where it says; empty: it can."""
        is_new = bool(problem) and not self._told
        self._told = bool(problem)
        return problem if is_new else ""


def reason_to_pause(robot: str, refused: Refused) -> str:
    """Why a robot's refusal pauses the mission until a person resumes it; empty if it doesn't."""
    if refused.name == "halted":  # releasing the robot isn't enough
        return f"robot {robot} is halted: release it, then resume this mission"
    return f"robot {robot} isn't ready: {refused}" if refused.name == "not_ready" else ""
