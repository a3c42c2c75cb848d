from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from surveilnav.robot_frame import PlanarTransform
from surveilnav.robot_state import RobotState
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.simulator.world.clear_paths import ClearPaths
from surveilnav.simulator.world.continuous_robot import ContinuousRobot
from surveilnav.simulator.world.localisation import LocalisationSettings
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.simulated_nav2 import NavigationGoal, SimulatedNav2

DT_S = 0.05
ELSEWHERE = PlanarTransform(3.0, -2.0, 2.0)
DRIFTING = LocalisationSettings(ELSEWHERE, 0.01, 0.005, sigma_m=0.02, sigma_yaw_rad=0.01)
START = RobotState(1.0, 3.0, 0.0, "0", 0.0)


@pytest.fixture(scope="module")
def two_rooms(boxes, room) -> NavigationMap:
    """Rooms of 4 x 6 m with a door of 0.8 m between them, and a closet that nothing leads into."""
    walls = [
        ("wall", "0", (4.0, 0.0, 0.0), (4.1, 2.6, 2.5)),
        ("wall", "0", (4.0, 3.4, 0.0), (4.1, 6.0, 2.5)),
        ("wall", "0", (6.0, 4.5, 0.0), (6.1, 6.0, 2.5)),
        ("wall", "0", (6.1, 4.5, 0.0), (8.0, 4.6, 2.5)),
    ]
    return NavigationMap.build(boxes([*room(8.0, 6.0), *walls]))


@pytest.fixture(scope="module", params=["parametric_flat", pytest.param("studio", marks=pytest.mark.assets)])
def home(request, home_cache: Path) -> NavigationMap:
    with pytest.MonkeyPatch.context() as environ:
        environ.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
        return SimulatedBuilding(SimulationSettings(building=request.param)).navigation


def run(nav2: SimulatedNav2, goal: NavigationGoal, most_s: float = 120.0) -> NavigationGoal:
    for _ in range(round(most_s / DT_S)):
        if goal.status != "executing":
            break
        nav2.advance(DT_S)
        assert nav2.robot.navigation.is_navigable(nav2.robot.state.p_world, nav2.robot.floor)
    return goal


def at(robot: ContinuousRobot, x_m: float, y_m: float, yaw_rad: float = 0.0) -> PlanarTransform:
    """A pose in the building as one in the robot's map."""
    return robot.localisation.T_building_map.inverse() @ PlanarTransform(x_m, y_m, yaw_rad)


def test_it_reaches_every_place_of_a_home_by_its_own_estimate(home):
    rng = np.random.default_rng(1)
    floor = max(home.robot_area, key=lambda f: home.robot_area[f].sum())
    robot = ContinuousRobot(home, RobotState(*home.random_point(rng, floor), floor, 0.0), localisation=DRIFTING, seed=1)
    nav2 = SimulatedNav2(robot)
    for _ in range(25):
        x_m, y_m, _ = home.random_point(rng, floor)
        shortest_m, before_m = (
            home.distance_field({floor: [(x_m, y_m)]}).at(robot.state.p_world, floor),
            robot.state.path_m,
        )
        goal = run(nav2, nav2.send(at(robot, x_m, y_m, float(rng.uniform(-3, 3)))))
        assert (goal.status, goal.why) == ("succeeded", "")
        off_m, off_rad = robot.localisation.pose.difference(goal.pose)
        assert (off_m <= 0.15, off_rad <= 0.15) == (True, True)
        assert math.hypot(robot.state.x_m - x_m, robot.state.y_m - y_m) < 0.3
        assert robot.state.path_m - before_m < 1.4 * shortest_m + 0.5
        assert goal.elapsed_s < 4 * shortest_m + 12


def test_it_keeps_away_from_walls_where_there_is_room(two_rooms):
    paths = ClearPaths(two_rooms.floors["0"])
    way = paths.path((1.0, 0.5), (7.0, 0.5))
    assert (way[0], way[-1]) == ((1.0, 0.5), (7.0, 0.5))
    door = [y for x, y in _sampled(way) if 3.9 < x < 4.2]
    assert door == pytest.approx([3.0] * len(door), abs=0.15)
    for x, y in _sampled(way):
        assert two_rooms.is_navigable((x, y), "0")
        assert y > 0.4 or x < 1.5 or x > 6.5
    assert paths.path((1.0, 1.0), (1.0, 1.0)) == [(1.0, 1.0), (1.0, 1.0)]
    assert paths.path((1.0, 1.0), (7.0, 5.3)) == []
    assert paths.path((1.0, 1.0), (70.0, 5.3)) == []


def _sampled(way: list[tuple[float, float]]) -> list[tuple[float, float]]:
    shares = np.linspace(0, 1, 50)
    return [tuple(np.add(a, s * np.subtract(b, a))) for a, b in pairwise(way) for s in shares]


@pytest.mark.parametrize(
    ("x_m", "y_m", "status", "why"),
    [
        (4.05, 1.0, "succeeded", ""),  # in a wall, and free ground is near
        (7.1, 5.3, "aborted", r"no path to \(7\.10, 5\.30\)"),
        (30.0, 5.3, "aborted", r"no path to"),
    ],
)
def test_a_goal_in_an_obstacle_counts_as_the_nearest_free_place(two_rooms, x_m, y_m, status, why):
    nav2 = SimulatedNav2(ContinuousRobot(two_rooms, START))
    goal = run(nav2, nav2.send(PlanarTransform(x_m, y_m, 1.0)))
    assert goal.status == status
    assert goal.why.startswith(why.replace("\\", "").split("(")[0])
    if status == "succeeded":
        assert nav2.robot.state.x_m == pytest.approx(3.8, abs=0.2)
        assert nav2.robot.state.yaw_rad == pytest.approx(1.0, abs=0.15)


def test_a_newer_goal_replaces_the_older_and_cancel_brakes(two_rooms):
    nav2 = SimulatedNav2(ContinuousRobot(two_rooms, START))
    first = nav2.send(PlanarTransform(7.0, 1.0, 0.0))
    nav2.advance(2.0)
    assert 0 < first.distance_remaining_m < 8
    second = nav2.send(PlanarTransform(3.0, 5.0, 0.0))
    assert (first.status, first.why) == ("aborted", "a newer goal replaced it")
    nav2.advance(3.0)
    assert nav2.robot.speed_m_s > 0.2
    assert nav2.cancel(second)
    assert not nav2.cancel(second)
    nav2.advance(1.0)
    assert (second.status, nav2.robot.speed_m_s, nav2.robot.turn_rate_rad_s) == ("canceled", 0.0, 0.0)


def test_without_progress_it_tries_again_and_then_aborts(two_rooms):
    nav2 = SimulatedNav2(ContinuousRobot(two_rooms, START))
    goal = nav2.send(PlanarTransform(7.0, 1.0, 0.0))
    nav2.advance(2.0)
    nav2.robot.held = True
    nav2.advance(4.0)
    assert (goal.status, goal.recoveries) == ("executing", 1)
    run(nav2, goal)
    assert (goal.status, goal.why, goal.recoveries) == ("aborted", "no progress for 10 s", 3)
    assert goal.elapsed_s == pytest.approx(12.0, abs=0.5)


def test_a_lost_robot_gives_up(two_rooms):
    nav2 = SimulatedNav2(ContinuousRobot(two_rooms, START))
    goal = nav2.send(PlanarTransform(7.0, 1.0, 0.0))
    nav2.advance(1.0)
    nav2.robot.localisation.lost = True
    nav2.advance(DT_S)
    assert (goal.status, goal.why) == ("aborted", "the robot has lost its localisation")


def test_a_jump_of_its_localisation_leads_it_to_a_wrong_place_and_into_no_wall(two_rooms):
    robot = ContinuousRobot(two_rooms, START, localisation=LocalisationSettings(ELSEWHERE))
    nav2 = SimulatedNav2(robot)
    goal = nav2.send(at(robot, 6.0, 2.0))
    nav2.advance(3.0)
    robot.jump(0.5, 0.0)
    run(nav2, goal)
    assert goal.status == "succeeded"
    assert math.hypot(robot.state.x_m - 6.0, robot.state.y_m - 2.0) == pytest.approx(0.5, abs=0.17)


def test_the_same_seed_drives_the_same_way(two_rooms):
    ends = []
    for _ in range(2):
        robot = ContinuousRobot(two_rooms, START, localisation=DRIFTING, seed=4)
        nav2 = SimulatedNav2(robot)
        run(nav2, nav2.send(at(robot, 7.0, 1.0, 1.0)))
        ends.append((robot.state, robot.localisation.pose))
    assert ends[0] == ends[1]
