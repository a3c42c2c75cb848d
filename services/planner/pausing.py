"""Why a mission waits for a person or for a passage, and what they said as it went on."""

from __future__ import annotations

import threading
from collections.abc import Callable

import msgspec

from surveilnav.bus import Refused
from surveilnav.services.planner.areas import MissionAreas
from surveilnav.services.planner.store import PassageWait, SavedMission

_CHECK_S = 0.1


class PausedError(Exception):
    """The mission is paused. What it decided last is carried out once it is resumed."""


class Pause:
    """Whether a mission is paused, and why. Any thread may begin and end the pause.

    Attributes:
        reason: why the mission is paused; None while it isn't paused.
        stored_reason: the same, but None if the pause ends by itself.
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

    def end(self) -> None:
        """Resumes the mission."""
        with self._lock:
            self.reason, self._is_over = None, None
            self._ended.set()

    @property
    def ends_itself(self) -> bool:
        """Whether the mission is paused, and goes on without a person."""
        return self._is_over is not None

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


class Pauses:
    """All pauses of one mission: those that a person begins, and those for its robot or for a passage.

    ``for_…`` begins one, and returns whether it did. The mission waits at its next ``check``.
    """

    def __init__(self, areas: MissionAreas, saved: SavedMission) -> None:
        self._areas, self._pause = areas, Pause(saved.paused)
        self._frame_problem_reported = saved.frame_problem_reported
        self._wait = saved.waits_for
        self._areas.vouched = saved.vouched
        if self._wait is not None:
            self._areas.remember_closed(self._wait.floor, self._wait.passages)
            self._wait_for_passages(self._wait)

    @property
    def reason(self) -> str | None:
        """Why the mission is paused; None while it isn't."""
        return self._pause.reason

    def written_into(self, saved: SavedMission) -> SavedMission:
        """The same with what a planner that is started again has to know: why the mission waits, and what people said."""
        return msgspec.structs.replace(
            saved,
            paused=self._pause.stored_reason,
            waits_for=self._wait if self._pause.ends_itself else None,
            vouched=self._areas.vouched,
            frame_problem_reported=self._frame_problem_reported,
        )

    def begin(self, reason: str) -> None:
        """Pauses the mission, until a person resumes it, once the current action is done."""
        self._pause.begin(reason)

    def resume(self) -> None:
        """A person resumes the mission. If it waits for passages and for nothing else, that says that they can be passed."""
        if self._pause.ends_itself and self._wait is not None:
            self._areas.vouch(self._wait.floor, self._wait.passages)
        self._pause.end()

    def check(self) -> None:
        """Raises PausedError if the mission is paused."""
        self._pause.check()

    def wait(self, interrupted: Callable[[], bool]) -> bool:
        """Waits until the mission goes on. False: it was interrupted before."""
        while self._pause.reason is not None:
            if interrupted():
                return False
            self._pause.wait(_CHECK_S)
        return True

    def for_frame(self, problem: str) -> bool:
        """Pauses once as the robot turns out not to be where it says. Whoever resumes the mission nevertheless is obeyed.

        ``problem``: why the robot can't be where it says; empty: it can.
        """
        is_new = bool(problem) and not self._frame_problem_reported
        self._frame_problem_reported = bool(problem)
        return is_new and self._pause.begin(problem)

    def for_refusal(self, robot: str, refused: Refused) -> bool:
        """Pauses, until a person resumes the mission, if a robot has refused a command because it can't drive now."""
        why = ""
        if refused.name == "halted":  # releasing the robot isn't enough
            why = f"robot {robot} is halted: release it, then resume this mission"
        elif refused.name == "not_ready":
            why = f"robot {robot} isn't ready: {refused}"
        return bool(why) and self._pause.begin(why)

    def for_passages(self, reason: str, floor: str, passages: tuple[str, ...]) -> bool:
        """Pauses until one of these passages isn't closed any more, or a person has the mission go on."""
        return self._wait_for_passages(PassageWait(reason=reason, floor=floor, passages=passages))

    def _wait_for_passages(self, wait: PassageWait) -> bool:
        self._wait = wait
        return self._pause.begin(wait.reason, lambda: not self._areas.are_closed(wait.floor, wait.passages))
