"""A robot's way from floor to floor: what tells a floor from a stair."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core.config import MapConfig

_LEVEL_M = 0.1  # of altitude: within this a robot stays on one level


@dataclass(frozen=True, slots=True)
class Walk:
    """A robot's last view, and the level that it has been on since.

    Attributes:
        floor: where the view went to.
        z_m: altitude of the ground under it.
        level_m: (x, y, z) where the level began, its altitude last [m, world].
        views: from the level.
    """

    floor: str
    z_m: float
    level_m: tuple[float, float, float]
    views: int

    @classmethod
    def begun(cls, view: PosedView, floor: str) -> Walk:
        """Of a robot's first view."""
        at_m = _ground_m(view)
        return cls(floor, at_m[2], at_m, 0).on(view, floor)

    def on(self, view: PosedView, floor: str) -> Walk:
        """The walk one view later."""
        at_m = _ground_m(view)
        if abs(at_m[2] - self.level_m[2]) <= _LEVEL_M:
            return Walk(floor, at_m[2], self.level_m, self.views + 1)
        return Walk(floor, at_m[2], at_m, 1)

    def climbs(self, view: PosedView, config: MapConfig, *, new_name: bool) -> bool:
        """Whether a robot whose next view is at an altitude of no floor is on a stair.

        It isn't where it came from nowhere, walked on one level, or looked around on it under a new floor name.
        """
        if abs(view.floor_z_m - self.z_m) > config.stair_step_m:
            return False
        now = self.on(view, self.floor)
        looked = new_name and now.views >= config.level_views
        return not looked and math.dist(now.level_m[:2], _ground_m(view)[:2]) < config.level_m

    def state(self) -> dict[str, Any]:
        """All of it, as plain values, for ``of_state``, by the names that snapshots have had from the start."""
        return {"storey": self.floor, "z_m": self.z_m, "level_m": self.level_m, "views": self.views}

    @classmethod
    def of_state(cls, state: dict[str, Any]) -> Walk:
        """The walk that ``state`` was taken of."""
        x, y, z = state["level_m"]
        return cls(state["storey"], state["z_m"], (x, y, z), state["views"])


def _ground_m(view: PosedView) -> tuple[float, float, float]:
    """(x, y, z) [m, world] of the ground under a view."""
    return float(view.T_world_camera[0, 3]), float(view.T_world_camera[1, 3]), float(view.floor_z_m)
