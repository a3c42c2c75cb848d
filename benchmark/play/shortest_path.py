"""The planner ``sp``: drives the shortest way on the simulator's true navigation mesh, with a robot's own actions.

An upper bound, not a method: the mesh is ground truth, which only the benchmark may use. What to drive to is still
chosen from what was seen.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.inputs import RobotView
from surveilnav.services.planner.core.motion.drive import HEADINGS, Route
from surveilnav.services.planner.core.motion.terrain import Terrain
from surveilnav.simulator.world.distance_field import DistanceField
from surveilnav.simulator.world.navigation import NavigationMap


class ShortestPathPlanner:
    """A ``LocalPlanner`` that knows the building."""

    def __init__(self, navigation: NavigationMap) -> None:
        self._navigation = navigation
        self._kept: tuple[object, DistanceField] | None = None  # one goal is asked for often

    def route(
        self, terrain: Terrain, goals: NDArray[np.bool_], robot: RobotView, config: PlannerConfig
    ) -> Route | None:
        """See ``LocalPlanner``. Goal cells in which the robot can't truly stand don't count."""
        places = terrain.grid.centres_of(np.argwhere(goals)).reshape(-1, 2)
        key = robot.floor, places.tobytes()
        if self._kept is None or self._kept[0] != key:
            self._kept = key, self._navigation.distance_field({robot.floor: places})
        field = self._kept[1]
        left_m = field.at((robot.x_m, robot.y_m), robot.floor)
        if math.isinf(left_m):
            return None
        path = tuple((w.x_m, w.y_m) for w in field.path_from((robot.x_m, robot.y_m), robot.floor))
        return Route(self._action(field, robot, config), path, left_m)

    def _action(self, field: DistanceField, robot: RobotView, config: PlannerConfig) -> str:
        """Turns to, or drives along, the heading whose whole step is free and ends nearest to the goal, with a small
        price per turn as ``FmmPlanner`` has it; the least blocked one where none is free."""
        here = robot.x_m, robot.y_m

        def cost(turns: int) -> tuple[float, float]:
            yaw_rad = robot.yaw_rad + turns * config.turn_rad
            there = here[0] + config.step_m * math.cos(yaw_rad), here[1] + config.step_m * math.sin(yaw_rad)
            free = self._navigation.way_free(here, there, robot.floor)
            left_m = field.at(there, robot.floor) if free >= 1.0 else math.inf
            return left_m + config.turn_cost_m * abs(turns), -free

        best = min((int(turns) for turns in HEADINGS), key=cost)
        return "move_forward" if best == 0 else "turn_left" if best > 0 else "turn_right"
