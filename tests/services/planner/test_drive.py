"""From a travel-time field to actions: a robot of twelve headings and whole steps gets through what its map says is open."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from services.planner.core import MapView, MissionState, PlannerConfig, RobotView
from services.planner.core.motion.drive import FmmPlanner, bearing_error_rad, turn_towards
from services.planner.core.motion.terrain import build_terrain
from surveilnav.geometry import Grid

CONFIG = PlannerConfig()
GRID = Grid(0.0, 0.0, 0.05, 80, 80)


def terrain_with(speed):
    nothing = np.zeros(GRID.shape, np.uint8)
    maps = MapView("0", 0.0, GRID, nothing, np.ones(GRID.shape, np.uint8), nothing, np.full(GRID.shape, np.nan), [], 1)
    return replace(build_terrain(maps, robot_at(2.0, 2.0), MissionState("x"), CONFIG), speed=speed)


def robot_at(x, y, yaw=0.0):
    return RobotView(0, x, y, yaw, 0.0, "0", False, None, 0.0)


def drive(terrain, robot, goals, most=80):
    """Actions until a goal cell is reached; a move that meets a blocked cell doesn't happen and is remembered as a bump."""
    for n in range(most):
        if goals[terrain.cell(robot.x_m, robot.y_m)]:
            return n
        action = FmmPlanner().route(terrain, goals, robot, CONFIG).action
        if action == "move_forward":
            t = np.linspace(0.0, 1.0, 26)[:, None] * CONFIG.step_m
            way = np.array([robot.x_m, robot.y_m]) + t * (math.cos(robot.yaw_rad), math.sin(robot.yaw_rad))
            cells = GRID.cells_of(way)
            if (terrain.speed[cells[:, 0], cells[:, 1]] > 0).all():
                robot = replace(robot, x_m=float(way[-1, 0]), y_m=float(way[-1, 1]))
            else:
                bump = [robot.x_m, robot.y_m, robot.yaw_rad]
                terrain = replace(terrain, bumps=np.vstack([terrain.bumps, bump]))
        else:
            turn = CONFIG.turn_rad if action == "turn_left" else -CONFIG.turn_rad
            robot = replace(robot, yaw_rad=robot.yaw_rad + turn)
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
