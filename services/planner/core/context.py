"""Everything that is known at one step, and what frontier rules and behaviours build from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.decision import Decision, Phase
from surveilnav.services.planner.core.goals.frontier_access import split_by_access
from surveilnav.services.planner.core.goals.frontiers import Frontier
from surveilnav.services.planner.core.inputs import FloorMaps, RobotView
from surveilnav.services.planner.core.memory.mission_state import MissionState
from surveilnav.services.planner.core.motion.areas import Area, barring_area
from surveilnav.services.planner.core.motion.drive import LocalPlanner, Route
from surveilnav.services.planner.core.motion.terrain import Terrain, lines_are_clear
from surveilnav.services.planner.core.options.option import Option
from surveilnav.services.planner.core.reach import Reach


@dataclass(frozen=True, slots=True)
class RatedFrontier:
    """A frontier as a ``FrontierRule`` rates it.

    Attributes:
        chance: that exploring it finds the target. ``utility``: comparable with the utilities of objects.
        cost_m: what exploring it is expected to cost [m]: the way there, and the way beyond.
        why: what rated it so, for people.
    """

    frontier: Frontier
    chance: float
    utility: float
    cost_m: float
    why: str


class FrontierRule(Protocol):
    """Rates frontiers. Ours are those of ``options.frontiers.rule_of``; the baselines of the benchmark bring their own."""

    def __call__(self, context: StepContext, found: Sequence[Frontier]) -> list[RatedFrontier]:
        """Rates the frontiers that the robot may explore (there may be none); those that it leaves out aren't explored.

        It may be asked several times a step, also while the robot does something else.
        """


@dataclass(frozen=True, eq=False)
class StepContext:
    """Everything that is known at this step.

    Asking it never changes anything. ``state`` is the step's own copy; what the robot does changes it through the methods of
    ``MissionState``. ``reach``: the maps, and where the robot can get to. ``retries_blacklisted``: a group of options has nothing
    else left, so only what is blacklisted permanently counts as blacklisted.
    """

    state: MissionState
    robot: RobotView
    config: PlannerConfig
    planner: LocalPlanner
    summaries: Mapping[str, Mapping[str, float]]
    rule: FrontierRule
    reach: Reach
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
        """Finds out where the robot can get to."""
        reach = Reach.from_inputs(state, maps, robot, config)
        return cls(state, robot, config, planner, summaries, rule, reach)

    def anew(self, state: MissionState) -> StepContext:
        """This step with another memory, by which the terrain may reach farther: to stairs that nobody has seen."""
        return StepContext.from_inputs(
            state, self.maps, self.robot, self.config, self.planner, self.summaries, self.rule
        )

    @property
    def maps(self) -> FloorMaps:
        return self.reach.maps

    @property
    def terrain(self) -> Terrain:
        return self.reach.terrain

    @property
    def travel_time_m(self) -> NDArray[np.float64]:
        return self.reach.travel_time_m

    @property
    def possible_targets(self) -> Sequence[ObjectRecord]:
        """The objects of this floor that may be the target."""
        return self.reach.possible_targets

    @cached_property
    def frontiers_by_access(self) -> tuple[list[Frontier], list[Frontier]]:
        """``split_by_access``, asked once a choice: what is remembered mustn't change in between."""
        return split_by_access(self)

    def with_open(self, passages: Sequence[Area]) -> StepContext:
        """This step as it would be if these passages were open."""
        return replace(self, reach=self.reach.with_open(passages))

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
