"""From a travel-time field to actions: a robot of twelve headings and whole steps gets through what its map says is open."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from surveilnav.geometry import Grid
from surveilnav.robot_body import clearance_m
from surveilnav.services.planner.core import FloorMaps, MissionState, PlannerConfig, RobotView
from surveilnav.services.planner.core.motion.drive import FmmPlanner, bearing_error_rad, turn_towards
from surveilnav.services.planner.core.motion.terrain import build_terrain

CONFIG = PlannerConfig()
GRID = Grid(0.0, 0.0, 0.05, 80, 80)


def explored(occupied=None):
    """A map of which all is explored, on cells like ``GRID``'s."""
    occupied = np.zeros(GRID.shape, np.uint8) if occupied is None else occupied
    grid = replace(GRID, rows=occupied.shape[0], cols=occupied.shape[1])
    rest = np.ones_like(occupied), np.zeros_like(occupied), np.full(occupied.shape, np.nan)
    return FloorMaps("0", 0.0, grid, occupied, *rest, [], 1)


def terrain_with(speed):
    return replace(build_terrain(explored(), robot_at(2.0, 2.0), MissionState("x"), CONFIG), speed=speed)


def robot_at(x, y, yaw=0.0):
    return RobotView(0, x, y, yaw, 0.0, "0", False, None, 0.0)


def act(robot, action, free, grid=GRID):
    """The robot after an action. A move that meets a cell that isn't ``free`` (bool) doesn't happen."""
    if action == "move_forward":
        t = np.linspace(0.0, 1.0, 26)[:, None] * CONFIG.step_m
        way = np.array([robot.x_m, robot.y_m]) + t * (math.cos(robot.yaw_rad), math.sin(robot.yaw_rad))
        cells = grid.cells_of(way)
        if not free[cells[:, 0], cells[:, 1]].all():
            return replace(robot, collided=True, last_action=action)
        return replace(robot, x_m=float(way[-1, 0]), y_m=float(way[-1, 1]), collided=False, last_action=action)
    turn = CONFIG.turn_rad if action == "turn_left" else -CONFIG.turn_rad
    return replace(robot, yaw_rad=robot.yaw_rad + turn, collided=False, last_action=action)


def drive(terrain, robot, goals, most=80):
    """Actions until a goal cell is reached; a move that meets a blocked cell doesn't happen and is remembered as a bump."""
    for n in range(most):
        if goals[terrain.cell(robot.x_m, robot.y_m)]:
            return n
        robot = act(robot, FmmPlanner().route(terrain, goals, robot, CONFIG).action, terrain.speed > 0.0)
        if robot.collided:
            terrain = replace(terrain, bumps=np.vstack([terrain.bumps, [robot.x_m, robot.y_m, robot.yaw_rad]]))
    return None


@pytest.mark.parametrize("gap_cells", [1, 2, 3])
@pytest.mark.parametrize("seed", range(10))
def test_lines_up_for_a_slit(gap_cells, seed):
    """A slit of 5 to 15 cm in a wall: few of the places that steps lead to lie before it. (Looking one step ahead, three
    in four such drives pace before the narrowest for ever.)"""
    rng = np.random.default_rng(seed)
    speed = np.ones(GRID.shape)
    speed[:, 40:43] = 0.0
    at = int(rng.integers(15, 60))
    speed[at : at + gap_cells, 40:43] = 1.0
    terrain = terrain_with(speed)
    robot = robot_at(float(rng.uniform(0.5, 1.6)), float(rng.uniform(0.5, 3.5)), float(rng.uniform(-3, 3)))
    assert drive(terrain, robot, terrain.disc(3.5, 2.0, 0.2)) is not None


def cluttered_door(seed):
    """(occupancy, start): two rooms of 2.4 x 5 m with a door of 35 to 45 cm between them, and clutter."""
    rng = np.random.default_rng(seed)
    occupied = np.zeros((100, 100), np.uint8)
    occupied[[0, -1], :] = occupied[:, [0, -1]] = 1
    at, width = int(rng.integers(20, 80)), int(rng.integers(7, 10))
    for _ in range(int(rng.integers(3, 10))):
        row, col = rng.integers(5, 95, 2)
        rows, cols = rng.integers(2, 14, 2)
        occupied[row : row + rows, col : col + cols] = 1
    occupied[at - 2 : at + width + 2, 40:60] &= rng.random((width + 4, 20)) < 0.03
    occupied[:at, 48:52] = occupied[at + width :, 48:52] = 1
    return occupied, (float(rng.uniform(0.6, 1.8)), float(rng.uniform(0.6, 4.4)), float(rng.uniform(-3, 3)))


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4, 5, 92])
def test_goes_round_between_no_places_without_end(seed):
    """Without a price on places that it comes to again and again, 92 is a round of three places."""
    occupied, (x, y, yaw) = cluttered_door(seed)
    maps = explored(occupied)
    body_fits = clearance_m(occupied != 0, maps.grid.resolution_m) >= 0.14
    state, robot = MissionState("x"), robot_at(x, y, yaw)
    for _ in range(120):
        state.record_robot(robot, CONFIG)
        terrain = build_terrain(maps, robot, state, CONFIG)
        goals = terrain.disc(4.0, 2.5, 0.3) & (terrain.speed > 0.0)
        if goals[terrain.cell(robot.x_m, robot.y_m)]:
            return
        robot = act(robot, FmmPlanner().route(terrain, goals, robot, CONFIG).action, body_fits, maps.grid)
    pytest.fail(f"still at ({robot.x_m:.2f}, {robot.y_m:.2f}) after 120 steps")


def test_a_place_that_the_robot_only_passes_again_costs_nothing():
    maps, state, robot = explored(), MissionState("x"), robot_at(1.0, 1.0)
    revisits = []
    for x in (1.0, 1.0, 1.25, 1.0, 1.25, 1.0, 1.25, 1.0):
        state.record_robot(replace(robot, x_m=x), CONFIG)
        terrain = build_terrain(maps, robot, state, CONFIG)
        revisits.append(terrain.revisit_m[terrain.cell(1.0, 1.0)] / CONFIG.step_m)
    assert revisits == [0, 0, 0, 0, 0, 1, 1, 4]  # standing isn't coming; the third time costs
    for k in range(60):
        state.record_robot(replace(robot, x_m=0.52 + 0.05 * k), CONFIG)
    assert not build_terrain(maps, robot, state, CONFIG).revisit_m.any()


def test_straight_on_when_nothing_is_in_the_way():
    terrain = terrain_with(np.ones(GRID.shape))
    assert drive(terrain, robot_at(0.5, 2.0), terrain.disc(3.0, 2.0, 0.13)) == 10


def test_the_front_margin_never_hides_a_way_aside():
    """Shut in on three sides by what it bumped into, the robot backs out, though all that way leads up the field."""
    terrain = terrain_with(np.ones(GRID.shape))
    bumps = np.array([(1.0, 2.0, math.radians(a)) for a in range(-90, 91, 30)])
    route = FmmPlanner().route(replace(terrain, bumps=bumps), terrain.disc(3.0, 2.0, 0.2), robot_at(1.0, 2.0), CONFIG)
    assert route.action.startswith("turn")


@pytest.mark.parametrize(
    ("to", "error_deg", "turn"),
    [
        ((2.0, 1.0), 0.0, None),
        ((1.0, 2.0), 90.0, "turn_left"),
        ((1.0, 0.0), -90.0, "turn_right"),
        ((2.0, 1.2), 11.3, None),
    ],
)
def test_turns_to_what_lies_aside(to, error_deg, turn):
    robot = robot_at(1.0, 1.0)
    assert math.degrees(bearing_error_rad(robot, *to)) == pytest.approx(error_deg, abs=0.1)
    assert turn_towards(robot, *to, CONFIG) == turn
