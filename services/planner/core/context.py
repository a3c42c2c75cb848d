"""Everything that is known at one step, and what frontier rules and behaviours build from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.decision import Decision, Phase
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.frontiers import Frontier, find_frontiers
from surveilnav.services.planner.core.inputs import FloorMaps, RobotView
from surveilnav.services.planner.core.memory.mission_state import MissionState
from surveilnav.services.planner.core.motion.areas import Area, barring_area
from surveilnav.services.planner.core.motion.drive import LocalPlanner, Route
from surveilnav.services.planner.core.motion.terrain import (
    Terrain,
    build_terrain,
    coarse_travel_time_m,
    lines_are_clear,
)
from surveilnav.services.planner.core.options.option import Option


@dataclass(frozen=True, slots=True)
class RatedFrontier:
    """A frontier with the chance that exploring it finds the target, its utility (comparable with the utilities of objects), what
    rated it so, for people, and what exploring is expected to cost beyond the frontier [m]."""

    frontier: Frontier
    chance: float
    utility: float
    why: str
    spend_m: float


class FrontierRule(Protocol):
    """Rates frontiers. Ours is ``options.frontiers.by_chance_per_metre``; the baselines of the benchmark bring their own."""

    def __call__(self, context: StepContext, found: Sequence[Frontier]) -> list[RatedFrontier]:
        """Rates the frontiers that the robot may explore (there may be none); those that it leaves out aren't explored.

        It may be asked several times a step, also while the robot does something else.
        """


@dataclass(frozen=True, eq=False)
class StepContext:
    """Everything that is known at this step.

    Asking it never changes anything. ``state`` is the step's own copy; what the robot does changes it through the methods of
    ``MissionState``. ``travel_time_m``: from the robot to every cell of the terrain, in metres of comfortable free space.
    ``retries_blacklisted``: nothing else is left, so only what is blacklisted permanently counts as blacklisted.
    """

    state: MissionState
    maps: FloorMaps
    robot: RobotView
    config: PlannerConfig
    planner: LocalPlanner
    summaries: Mapping[str, Mapping[str, float]]
    rule: FrontierRule
    terrain: Terrain
    travel_time_m: NDArray[np.float64]
    retries_blacklisted: bool = False

    @classmethod
    def from_inputs(
        cls,
        state: MissionState,
        maps: FloorMaps,
        robot: RobotView,
        config: PlannerConfig,
        planner: LocalPlanner,
        summaries: Mapping[str, Mapping[str, float]],
        rule: FrontierRule,
    ) -> StepContext:
        """Builds the terrain around everything known and every possible goal, and the robot's travel times over it."""
        goals = objects.candidates(maps.objects, state, config) + objects.last_resorts(maps.objects, state, config)
        places = [o.center_m[:2] for o in goals] + _stairs_ends(state, robot, config)
        terrain = build_terrain(maps, robot, state, config, places)
        travel_time_m = coarse_travel_time_m(terrain, robot.x_m, robot.y_m)
        return cls(state, maps, robot, config, planner, summaries, rule, terrain, travel_time_m)

    def anew(self, state: MissionState) -> StepContext:
        """This step with another memory, by which the terrain may reach farther: to stairs that nobody has seen."""
        return StepContext.from_inputs(
            state, self.maps, self.robot, self.config, self.planner, self.summaries, self.rule
        )

    @cached_property
    def frontiers(self) -> list[Frontier]:
        """All frontiers that a way leads to."""
        return find_frontiers(self.maps, self.terrain, self.travel_time_m, self.config)

    @cached_property
    def unconstrained_travel_time_m(self) -> NDArray[np.float64]:
        """``travel_time_m`` for a robot that avoids narrow gaps, except where it stands in one."""
        here = self.terrain.disc(self.robot.x_m, self.robot.y_m, self.config.same_place_m)
        constrained = (self.terrain.speed <= self.config.constrained_speed) & ~here
        terrain = replace(self.terrain, speed=np.where(constrained, 0.0, self.terrain.speed))
        return coarse_travel_time_m(terrain, self.robot.x_m, self.robot.y_m)

    @cached_property
    def closed_passages(self) -> tuple[Area, ...]:
        """The passages of this floor that are known to be closed."""
        return tuple(area for area in self.maps.areas if area.kind == "closed")

    @cached_property
    def with_all_open(self) -> StepContext:
        """This step as it would be if every closed passage were open."""
        return self.with_open(self.closed_passages)

    def with_open(self, passages: Sequence[Area]) -> StepContext:
        """This step as it would be if these passages were open."""
        areas = tuple(replace(area, kind="open") if area in passages else area for area in self.maps.areas)
        opened = StepContext.from_inputs(
            self.state,
            replace(self.maps, areas=areas),
            self.robot,
            self.config,
            self.planner,
            self.summaries,
            self.rule,
        )
        return replace(opened, retries_blacklisted=self.retries_blacklisted)

    def is_blacklisted(self, x_m: float, y_m: float, *, confirmed: bool = False) -> bool:
        """Whether the robot leaves a place alone because it failed to reach it. ``confirmed``: a confirmed target is there."""
        permanently = self.retries_blacklisted
        return self.state.is_blacklisted(x_m, y_m, self.config, confirmed=confirmed, permanently=permanently)

    def area_at(self, x_m: float, y_m: float) -> str:
        """The name of the keepout zone or closed passage at a place; empty if there is none."""
        return barring_area(self.maps.areas, x_m, y_m)

    def leads_through_barred(self, x_m: float, y_m: float) -> bool:
        """Whether the straight line from the robot to a place touches a keepout zone or a closed passage."""
        barred = self.terrain.barred
        if barred is None:
            return False
        ends = self.terrain.cell(x_m, y_m), self.terrain.cell(self.robot.x_m, self.robot.y_m)
        return not bool(lines_are_clear(barred.near, np.array(ends[:1]), np.array(ends[1:]), 0.0)[0])

    def decide(
        self,
        action: str,
        phase: Phase,
        message: str,
        option: Option | None = None,
        route: Route | None = None,
        to_floor: str | None = None,
    ) -> Decision:
        """A decision for an action that serves an option, along a route if there is one."""
        here = self.robot.x_m, self.robot.y_m
        path = (here, *route.path[1:]) if route else (here,)
        length_m = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) if route else None
        return Decision(
            action,
            phase,
            message,
            to_floor,
            waypoint=option.to_candidate(chosen=True) if option else None,
            path=path,
            distance_m=length_m,
            object_id=option.record.id if option and option.record else None,
        )


def _stairs_ends(state: MissionState, robot: RobotView, config: PlannerConfig) -> list[tuple[float, float]]:
    """(x, y) [m] of the stairs of this floor that the robot may head for without having seen them."""
    if config.stairs_known == "seen" and not state.here.is_searched:
        return []
    return [stairs.at_m[:2] for stairs in robot.stairs if stairs.floor == robot.floor]
