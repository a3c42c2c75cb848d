"""One step in the making: everything known about it, and what every kind of waypoint needs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from services.planner.core import memory
from services.planner.core.drive import LocalPlanner, Route
from services.planner.core.frontiers import Frontier, find_frontiers
from services.planner.core.settings import PlannerConfig
from services.planner.core.state import Commitment, Decision, MapView, MissionState, RobotView
from services.planner.core.terrain import Terrain, coarse_arrival_m
from surveilnav.messages import Candidate


class FrontierRule(Protocol):
    """Which frontier to explore next; ``choose.choose_frontier`` is ours, those of others can stand in for it."""

    def __call__(self, now: Now, *, hard: bool) -> Frontier | None:
        """Commits to one of ``choose.open_frontiers`` by ``choose.head_for``; None: nothing is left to explore.
        ``hard``: also those that are hard to get to."""


@dataclass(slots=True, eq=False)
class Now:
    """This step; ``state`` is the copy that it may change.

    ``arrival``: travel time [m] from the robot to every cell of the terrain; ``weighed``: the waypoints compared.
    """

    state: MissionState
    maps: MapView
    robot: RobotView
    config: PlannerConfig
    planner: LocalPlanner
    summaries: Mapping[str, Mapping[str, float]]
    rule: FrontierRule
    terrain: Terrain
    arrival: NDArray[np.float64]
    weighed: list[Candidate] = field(default_factory=list)
    _wide: NDArray[np.float64] | None = None
    _frontiers: list[Frontier] | None = None

    def frontiers(self) -> list[Frontier]:
        """All that a way leads to."""
        if self._frontiers is None:
            self._frontiers = find_frontiers(self.maps, self.terrain, self.arrival, self.config)
        return self._frontiers

    def wide_arrival(self) -> NDArray[np.float64]:
        """The same as ``arrival`` without tight places, but those where the robot stands."""
        if self._wide is None:
            here = self.terrain.disc(self.robot.x_m, self.robot.y_m, self.config.same_place_m)
            tight = (self.terrain.speed <= self.config.tight_speed) & ~here
            wide = replace(self.terrain, speed=np.where(tight, 0.0, self.terrain.speed))
            self._wide = coarse_arrival_m(wide, self.robot.x_m, self.robot.y_m)
        return self._wide

    def commit(self, chosen: Candidate, *, last_resort: bool = False) -> None:
        """Notes the waypoint; patience starts anew only for another place."""
        state, held = self.state, self.state.commitment
        if held is not None and _same(held, chosen, 1.5 * self.config.same_place_m):
            state.commitment = replace(held, kind=chosen.kind, x_m=chosen.x_m, y_m=chosen.y_m)
            return
        state.peeks = 0
        state.commitment = Commitment(
            chosen.kind, chosen.x_m, chosen.y_m, state.step, None, state.step, chosen.object_id, last_resort
        )

    def drive(self, goals: NDArray[np.bool_]) -> Route | None:
        """The way to the goals; None, and the waypoint is given up, if there is none or nothing was gained for long."""
        state, config, held = self.state, self.config, self.state.commitment
        assert held is not None
        route = self.planner.route(self.terrain, goals, self.robot, config)
        best_m = math.inf if held.best_m is None else held.best_m
        if route is not None and route.remaining_m > best_m + config.detour_m and held.detours < config.max_detours:
            # the map showed that the way is longer: what was gained on the old one says nothing about the new one
            held = replace(held, best_m=None, detours=held.detours + 1)
        if route is not None and (held.best_m is None or route.remaining_m < held.best_m - 0.1):
            state.commitment = replace(held, best_m=route.remaining_m, best_step=state.step)
        elif route is None or state.step - held.best_step > config.patience_steps:
            if held.kind == "target":
                place = f"({held.x_m:.1f}, {held.y_m:.1f})"
                state.unreachable = f"{state.target!r} was seen at {place}, but the robot can't get near it"
            memory.give_up_waypoint(state, config)
            return None
        return route

    def level(self) -> Decision | None:
        """Brings the camera back to the horizon after a look."""
        if abs(self.robot.pitch_rad) <= self.config.turn_rad / 2:
            return None
        return self.decide("look_up" if self.robot.pitch_rad < 0 else "look_down", "exploring", "levelling the camera")

    def decide(
        self, action: str, phase: str, message: str, route: Route | None = None, to_floor: str | None = None
    ) -> Decision:
        """A decision for the waypoint chosen."""
        chosen = next((c for c in self.weighed if c.chosen), None)
        here = self.robot.x_m, self.robot.y_m
        path = (here, *route.path[1:]) if route else (here,)
        length_m = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) if route else None
        object_id = chosen.object_id if chosen else None
        return Decision(
            action, phase, message, to_floor, plan=chosen, path=path, distance_m=length_m, object_id=object_id
        )


def _same(held: Commitment, chosen: Candidate, near_m: float) -> bool:
    """Whether a waypoint is the one held: the same object, or about the same place for the same purpose."""
    if held.object_id is not None or chosen.object_id is not None:
        return held.object_id == chosen.object_id
    purpose = (held.kind == "stairs") == (chosen.kind == "stairs")
    return purpose and math.hypot(held.x_m - chosen.x_m, held.y_m - chosen.y_m) <= near_m
