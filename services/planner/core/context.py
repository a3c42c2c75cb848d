"""One step in the making: everything that is known about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from surveilnav.messages import Candidate
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.frontiers import Frontier, find_frontiers
from surveilnav.services.planner.core.motion.drive import LocalPlanner, Route
from surveilnav.services.planner.core.motion.terrain import Terrain, build_terrain, coarse_travel_time_m
from surveilnav.services.planner.core.state import Decision, MapView, MissionState, Phase, RobotView

_SHOWN = 12


@dataclass(frozen=True, slots=True)
class FrontierChoice:
    """What a ``FrontierRule`` says: the frontiers that it compared, the one to go to, and why."""

    compared: Sequence[Frontier]
    chosen: Frontier
    why: str


class FrontierRule(Protocol):
    """Which frontier to explore next; ``goals.frontier_choice.best_frontier`` is ours, those of others can stand in for it."""

    def __call__(self, context: StepContext, frontiers: Callable[[], list[Frontier]]) -> FrontierChoice | None:
        """One of ``frontiers()``, which may be none; None: nothing is left to explore."""


@dataclass(frozen=True, slots=True)
class Choice:
    """The waypoint chosen, among those that it was compared with."""

    chosen: Candidate
    compared: tuple[Candidate, ...]


@dataclass(frozen=True, eq=False)
class StepContext:
    """This step. Asking it changes nothing; ``state`` is the step's own copy, which only ``memory`` changes.

    ``travel_time_m``: from the robot to every cell of the terrain, in metres of comfortable free space.
    """

    state: MissionState
    maps: MapView
    robot: RobotView
    config: PlannerConfig
    planner: LocalPlanner
    summaries: Mapping[str, Mapping[str, float]]
    rule: FrontierRule
    terrain: Terrain
    travel_time_m: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        state: MissionState,
        maps: MapView,
        robot: RobotView,
        config: PlannerConfig,
        planner: LocalPlanner,
        summaries: Mapping[str, Mapping[str, float]],
        rule: FrontierRule,
    ) -> StepContext:
        """The terrain around everything known and everything that may be gone to, and the robot's travel time over it."""
        goals = objects.candidates(maps.objects, state, config) + objects.last_resorts(maps.objects, state, config)
        places = [o.center_m[:2] for o in goals] + _stair_ends(state, robot, config)
        terrain = build_terrain(maps, robot, state, config, places)
        travel_time_m = coarse_travel_time_m(terrain, robot.x_m, robot.y_m)
        return cls(state, maps, robot, config, planner, summaries, rule, terrain, travel_time_m)

    @cached_property
    def frontiers(self) -> list[Frontier]:
        """All that a way leads to."""
        return find_frontiers(self.maps, self.terrain, self.travel_time_m, self.config)

    @cached_property
    def roomy_travel_time_m(self) -> NDArray[np.float64]:
        """``travel_time_m`` without tight places, but those where the robot stands."""
        here = self.terrain.disc(self.robot.x_m, self.robot.y_m, self.config.same_place_m)
        tight = (self.terrain.speed <= self.config.tight_speed) & ~here
        roomy = replace(self.terrain, speed=np.where(tight, 0.0, self.terrain.speed))
        return coarse_travel_time_m(roomy, self.robot.x_m, self.robot.y_m)

    def decide(
        self,
        action: str,
        phase: Phase,
        message: str,
        choice: Choice | None = None,
        route: Route | None = None,
        to_floor: str | None = None,
    ) -> Decision:
        """A decision for the waypoint chosen."""
        here = self.robot.x_m, self.robot.y_m
        path = (here, *route.path[1:]) if route else (here,)
        length_m = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) if route else None
        chosen, compared = (choice.chosen, choice.compared[:_SHOWN]) if choice else (None, ())
        return Decision(
            action,
            phase,
            message,
            to_floor,
            waypoint=chosen,
            path=path,
            distance_m=length_m,
            candidates=compared,
            object_id=chosen.object_id if chosen else None,
        )


def _stair_ends(state: MissionState, robot: RobotView, config: PlannerConfig) -> list[tuple[float, float]]:
    """(x, y) [m] of the stairs of this floor that may be headed for unseen."""
    if config.stairs_known == "seen" and not state.here.exhausted:
        return []
    return [stair.at_m[:2] for stair in robot.stairs if stair.floor == robot.floor]
