"""The waypoint that the robot is heading for, and whether it makes progress towards it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from surveilnav.messages import Candidate
from surveilnav.services.planner.core.config import PlannerConfig

WaypointKind = Literal["target", "candidate", "frontier", "stairs", "second_look"]

#: Coming nearer by less than this isn't progress.
_PROGRESS_M = 0.1


@dataclass(frozen=True, slots=True)
class CurrentWaypoint:
    """The waypoint that the robot is heading for, at (x, y) [m, world].

    Attributes:
        best_remaining_m: the shortest remaining travel time to it so far [m]; None: not measured yet.
        progress_step: the mission step at which ``best_remaining_m`` was reached. Without progress for
            ``patience_steps`` the waypoint is abandoned.
        object_id: the object there, if it is one.
        is_fallback: it was chosen only because nothing better was left, so it needn't be promising.
        detours: how often the way turned out to be longer than it had seemed.
    """

    kind: WaypointKind
    x_m: float
    y_m: float
    best_remaining_m: float | None
    progress_step: int
    object_id: int | None = None
    is_fallback: bool = False
    detours: int = 0

    def is_same_as(self, candidate: Candidate, near_m: float) -> bool:
        """Whether a candidate is this waypoint: the same object, or a place within ``near_m`` for the same purpose."""
        if self.object_id is not None or candidate.object_id is not None:
            return self.object_id == candidate.object_id
        same_purpose = (self.kind == "stairs") == (candidate.kind == "stairs")
        return same_purpose and math.hypot(self.x_m - candidate.x_m, self.y_m - candidate.y_m) <= near_m

    def with_progress(self, remaining_m: float | None, step: int, config: PlannerConfig) -> CurrentWaypoint | None:
        """The waypoint once ``remaining_m`` (None: no way leads there) was measured at mission step ``step``.

        None: no way leads there, or there was no progress for too long. When the map shows that the way is longer than it
        had seemed, progress on the old way says nothing about the new one, so the waypoint gets new patience, at most
        ``max_detours`` times.
        """
        if remaining_m is None:
            return None
        best_m, detours = self.best_remaining_m, self.detours
        if best_m is not None and remaining_m > best_m + config.detour_m and detours < config.max_detours:
            best_m, detours = None, detours + 1
        if best_m is None or remaining_m < best_m - _PROGRESS_M:
            return replace(self, best_remaining_m=remaining_m, progress_step=step, detours=detours)
        return None if step - self.progress_step > config.patience_steps else self
