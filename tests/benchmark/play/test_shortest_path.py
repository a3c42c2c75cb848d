"""The oracle planner: the true shortest way, by a robot's own actions, whatever the map says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from surveilnav.benchmark.play.shortest_path import ShortestPathPlanner
from surveilnav.robot_state import RobotState
from surveilnav.services.planner.core import FloorMaps, MissionState, PlannerConfig, RobotView
from surveilnav.services.planner.core.motion.drive import FmmPlanner
from surveilnav.services.planner.core.motion.terrain import build_terrain
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.world import robot_motion
from surveilnav.simulator.world.navigation import NavigationMap

CONFIG = PlannerConfig()


@pytest.fixture(scope="module")
def navigation():
    return NavigationMap.build(open_building("parametric_house"))


def blank(navigation, state):
    """The terrain of a robot that has seen nothing."""
    floor = navigation.floors[state.floor]
    nothing = np.zeros(floor.grid.shape, np.uint8)
    value = np.full(floor.grid.shape, np.nan, np.float32)
    maps = FloorMaps(state.floor, floor.z_m, floor.grid, nothing, nothing, nothing, value, [], 1)
    corners = [floor.grid.centres_of((0, 0)), floor.grid.centres_of((floor.grid.rows - 1, floor.grid.cols - 1))]
    return build_terrain(maps, view_of(state), MissionState("x"), CONFIG, [tuple(c) for c in corners])


def view_of(state):
    return RobotView(
        state.seq, state.x_m, state.y_m, state.yaw_rad, 0.0, state.floor, state.collided, state.last_action, 0.0
    )


def drive(navigation, planner, start, goal, most=400):
    """The way driven [m] to within 0.2 m of the goal; None if the planner gives up."""
    state = RobotState(*start, navigation.floors["0"].z_m, "0", 0.3)
    terrain = blank(navigation, state)
    goals = terrain.disc(*goal, 0.15)
    for _ in range(most):
        if math.dist((state.x_m, state.y_m), goal) <= 0.2:
            return state.path_m
        route = planner.route(terrain, goals, view_of(state), CONFIG)
        if route is None:
            return None
        assert math.dist(route.path[0], (state.x_m, state.y_m)) < 0.2
        state = robot_motion.act(state, route.action, navigation)
    raise AssertionError("never arrived")


@pytest.mark.parametrize("seed", range(6))
def test_drives_the_true_shortest_way(navigation, seed):
    """Within 6 % and a step of the geodesic distance (headings come in twelfths), without a single collision."""
    floor = navigation.floors["0"]
    cells = np.argwhere(navigation.robot_area["0"])
    a, b = np.random.default_rng(seed).choice(len(cells), 2, replace=False)
    start, goal = (tuple(float(v) for v in floor.grid.centres_of(cells[i])) for i in (a, b))
    shortest_m = navigation.distance_field({"0": [goal]}).at(start, "0")
    assert drive(navigation, ShortestPathPlanner(navigation), start, goal) <= 1.06 * shortest_m + 0.3


def test_it_knows_what_the_map_does_not(navigation):
    """On an empty map the fair planner runs into walls; the oracle goes round them, and knows what is out of reach."""
    floor = navigation.floors["0"]
    blocked = np.argwhere(floor.obstacle)[0]
    here = floor.grid.centres_of(np.argwhere(navigation.robot_area["0"])[0])
    state = RobotState(float(here[0]), float(here[1]), floor.z_m, "0", 0.0)
    terrain = blank(navigation, state)
    goals = terrain.disc(*floor.grid.centres_of(blocked), 0.03)
    assert FmmPlanner().route(terrain, goals, view_of(state), CONFIG) is not None
    assert ShortestPathPlanner(navigation).route(terrain, goals, view_of(state), CONFIG) is None
