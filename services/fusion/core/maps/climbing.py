"""Telling a floor from a stair by the altitudes at which a robot observes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core.config import MapConfig

_LEVEL_M = 0.1  # a robot whose altitude changes by no more than this stays on one level


@dataclass(frozen=True, slots=True)
class ClimbTracker:
    """A robot's latest view, and the level that it has been on since it last climbed.

    Attributes:
        floor: the floor of the map that the view was integrated into.
        z_m: altitude of the ground under the robot [m, world].
        level_m: (x, y, z) [m, world] where the robot came onto its present level; z is the level's altitude.
        views: how many views the robot has taken on this level.
    """

    floor: str
    z_m: float
    level_m: tuple[float, float, float]
    views: int

    @classmethod
    def from_first_view(cls, view: PosedView, floor: str) -> ClimbTracker:
        at_m = _ground_m(view)
        return cls(floor, at_m[2], at_m, 0).after(view, floor)

    def after(self, view: PosedView, floor: str) -> ClimbTracker:
        """The tracker one view later."""
        at_m = _ground_m(view)
        if abs(at_m[2] - self.level_m[2]) <= _LEVEL_M:
            return ClimbTracker(floor, at_m[2], self.level_m, self.views + 1)
        return ClimbTracker(floor, at_m[2], at_m, 1)

    def is_on_stair(self, view: PosedView, config: MapConfig, *, new_name: bool) -> bool:
        """Whether a robot whose next view is at an altitude of no known floor is on a stair, rather than on a new floor.

        It is on a new floor if it jumped there (a lift, or a start), if it has moved along one level, or if it has looked
        around on one level and calls its floor by a name that the map doesn't know (``new_name``).
        """
        if abs(view.floor_z_m - self.z_m) > config.stair_step_m:
            return False
        current = self.after(view, self.floor)
        looked_around = new_name and current.views >= config.new_floor_views
        return not looked_around and math.dist(current.level_m[:2], _ground_m(view)[:2]) < config.new_floor_distance_m

    def state(self) -> dict[str, Any]:
        """Everything as plain values, for ``from_state``."""
        return {"floor": self.floor, "z_m": self.z_m, "level_m": self.level_m, "views": self.views}

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> ClimbTracker:
        x, y, z = state["level_m"]
        return cls(state["floor"], state["z_m"], (x, y, z), state["views"])


def _ground_m(view: PosedView) -> tuple[float, float, float]:
    """(x, y, z) [m, world] of the ground under a view."""
    return float(view.T_world_camera[0, 3]), float(view.T_world_camera[1, 3]), float(view.floor_z_m)
