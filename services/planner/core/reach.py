"""Where the robot can get to at this step, by the map and the place where it stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.frontiers import Frontier, find_frontiers
from surveilnav.services.planner.core.goals.goal_region import GoalRegion, goal_region
from surveilnav.services.planner.core.inputs import FloorMaps, RobotView
from surveilnav.services.planner.core.memory.mission_state import MissionState
from surveilnav.services.planner.core.motion.areas import Area
from surveilnav.services.planner.core.motion.terrain import Terrain, build_terrain, coarse_travel_time_m


@dataclass(frozen=True, eq=False)
class Reach:
    """The terrain of a step and what follows from it.

    What the robot chooses and what comes of it changes nothing here, so everything is worked out at most once a step, when it is
    first asked for.

    Attributes:
        state: what the mission remembers; only where the robot was and what it bumped into counts here.
        travel_time_m: from the robot to every cell of the terrain, in metres of comfortable free space.
        possible_targets: the objects of this floor that may be the target (``objects.possible_targets``).
    """

    state: MissionState
    maps: FloorMaps
    robot: RobotView
    config: PlannerConfig
    terrain: Terrain
    travel_time_m: NDArray[np.float64]
    possible_targets: Sequence[ObjectRecord]
    _times_m: dict[tuple[float, float, float, bool], float] = field(default_factory=dict, init=False)
    _regions: dict[tuple[int, tuple[tuple[float, float], ...]], GoalRegion | None] = field(
        default_factory=dict, init=False
    )

    @classmethod
    def from_inputs(cls, state: MissionState, maps: FloorMaps, robot: RobotView, config: PlannerConfig) -> Reach:
        """Builds the terrain around everything known and every possible goal, and the robot's travel times over it."""
        known = [record for record, _ in objects.possible_targets(maps.objects, state.target)]
        goals = objects.candidates(known, state, config) + objects.last_resorts(known, state, config)
        places = [o.center_m[:2] for o in goals] + _stairs_ends(state, robot, config)
        terrain = build_terrain(maps, robot, state, config, places)
        travel_time_m = coarse_travel_time_m(terrain, robot.x_m, robot.y_m)
        return cls(state, maps, robot, config, terrain, travel_time_m, known)

    @cached_property
    def frontiers(self) -> list[Frontier]:
        """All frontiers that a way leads to."""
        return find_frontiers(self.maps, self.terrain, self.travel_time_m, self.config)

    @cached_property
    def closed_passages(self) -> tuple[Area, ...]:
        """The passages of this floor that are known to be closed."""
        return tuple(area for area in self.maps.areas if area.kind == "closed")

    @cached_property
    def with_all_open(self) -> Reach:
        """Where the robot could get to if every closed passage were open."""
        return self.with_open(self.closed_passages)

    def with_open(self, passages: Sequence[Area]) -> Reach:
        """Where the robot could get to if these passages were open."""
        areas = tuple(replace(area, kind="open") if area in passages else area for area in self.maps.areas)
        return Reach.from_inputs(self.state, replace(self.maps, areas=areas), self.robot, self.config)

    def time_to_m(self, x_m: float, y_m: float, within_m: float, *, avoids_gaps: bool = False) -> float:
        """The least travel time [m] to within a distance of a place; inf: no way leads there. ``avoids_gaps``: for a robot that
        avoids narrow gaps, except where it stands in one."""
        asked = x_m, y_m, within_m, avoids_gaps
        if asked not in self._times_m:
            times_m = self._unconstrained_travel_time_m if avoids_gaps else self.travel_time_m
            self._times_m[asked] = self.terrain.min_near(times_m, x_m, y_m, within_m)
        return self._times_m[asked]

    @cached_property
    def _unconstrained_travel_time_m(self) -> NDArray[np.float64]:
        here = self.terrain.disc(self.robot.x_m, self.robot.y_m, self.config.same_place_m)
        constrained = (self.terrain.speed <= self.config.constrained_speed) & ~here
        terrain = replace(self.terrain, speed=np.where(constrained, 0.0, self.terrain.speed))
        return coarse_travel_time_m(terrain, self.robot.x_m, self.robot.y_m)

    def goal_region(self, record: ObjectRecord, looked_from: tuple[tuple[float, float], ...] = ()) -> GoalRegion | None:
        """The goal region of an object of this floor; None: no way leads near it. ``looked_from``: see ``goal_region``."""
        asked = record.id, looked_from
        if asked not in self._regions:
            self._regions[asked] = goal_region(
                self.terrain, self.travel_time_m, record, self.robot, self.config, self.maps.floor_z_m, looked_from
            )
        return self._regions[asked]


def _stairs_ends(state: MissionState, robot: RobotView, config: PlannerConfig) -> list[tuple[float, float]]:
    """(x, y) [m] of the stairs of this floor that the robot may head for without having seen them."""
    if config.stairs_known == "seen" and not state.here.is_searched:
        return []
    return [stairs.at_m[:2] for stairs in robot.stairs if stairs.floor == robot.floor]
