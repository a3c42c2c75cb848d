"""Planner and judge take the robot for the same body: what is passable for one is for the other, and it gets through."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.geometry import Grid
from surveilnav.robot_body import RADIUS_M, clearance_m, fits
from surveilnav.robot_state import RobotState
from surveilnav.services.planner.core import FloorMaps, FloorMemory, MissionState, PlannerConfig, RobotView
from surveilnav.services.planner.core.motion.drive import FmmPlanner
from surveilnav.services.planner.core.motion.terrain import build_terrain
from surveilnav.simulator.world import robot_motion
from surveilnav.simulator.world.free_ground import FloorNavigation, components_of
from surveilnav.simulator.world.navigation import NavigationMap

CONFIG = PlannerConfig()
R = 0.05
GRID = Grid(0.0, 0.0, R, 90, 90)
HERE, THERE = (0.75, 2.25), (3.75, 2.25)
#: Seven open cells: the narrowest corridor along the grid that the body fits into.
NARROWEST = 7


def test_clearance_is_exact_to_the_last_bit():
    """The same obstacles give the same clearance wherever the array lies in memory, so a search is reproducible."""
    rng = np.random.default_rng(0)
    for shape in ((77, 143), (40, 61)):
        blocked = rng.random(shape) < 0.01
        rows, cols = np.nonzero(blocked)
        i, j = np.indices(shape)
        squared = ((i[..., None] - rows) ** 2 + (j[..., None] - cols) ** 2).min(axis=-1)
        exact = np.sqrt(squared.astype(np.float32)) * np.float32(R)
        for _ in range(20):
            filler = np.empty(int(rng.integers(1, 5000)))  # moves what is allocated next
            assert np.array_equal(clearance_m(blocked.copy(), R), exact), filler.size


def corridor(cells, length=20, at=45):
    """A wall across the grid with a corridor of so many open cells through it."""
    blocked = np.zeros(GRID.shape, bool)
    blocked[:, 35 : 35 + length] = True
    blocked[at - cells // 2 : at - cells // 2 + cells, 35 : 35 + length] = False
    return blocked


def spilled(blocked):
    """What a map makes of it at worst: every obstacle a cell thicker all around."""
    return cv2.dilate(blocked.astype(np.uint8), np.ones((3, 3), np.uint8)) != 0


def terrain_of(blocked, robot, memory):
    nothing = np.zeros(GRID.shape, np.uint8)
    value = np.full(GRID.shape, np.nan, np.float32)
    maps = FloorMaps("0", 0.0, GRID, blocked.astype(np.uint8), np.ones(GRID.shape, np.uint8), nothing, value, [], 1)
    return build_terrain(maps, robot, MissionState("x", floor="0", floors={"0": memory}), CONFIG)


def judged(blocked):
    free = fits(clearance_m(np.pad(blocked, 1, constant_values=True), R))[1:-1, 1:-1]
    everywhere = np.ones(GRID.shape, bool)
    floor = FloorNavigation("0", 0.0, GRID, free, components_of(free), everywhere, everywhere, blocked)
    return NavigationMap({"0": floor}, (), RADIUS_M)


def arrives(blocked, mapped, yaw_rad, most=150):
    """Whether the planner, by the map, brings the body, in the world, from one side of the wall to the other."""
    world = judged(blocked)
    state, memory = RobotState(*HERE, 0.0, "0", yaw_rad), FloorMemory()
    for _ in range(most):
        if math.dist((state.x_m, state.y_m), THERE) < 0.3:
            return True
        robot = RobotView(0, state.x_m, state.y_m, state.yaw_rad, 0.0, "0", False, None, 0.0)
        terrain = terrain_of(mapped, robot, memory)
        route = FmmPlanner().route(terrain, terrain.disc(*THERE, 0.25), robot, CONFIG)
        if route is None:
            return False
        memory.visited.append((state.x_m, state.y_m))
        state = robot_motion.act(state, route.action, world)
        if state.collided:  # as the planner's memory notes it
            c, s = math.cos(state.yaw_rad), math.sin(state.yaw_rad)
            memory.bumps.append((state.x_m, state.y_m, state.yaw_rad))
            memory.collisions.append((state.x_m + R * c, state.y_m + R * s))
    return False


def way_there(mapped):
    robot = RobotView(0, *HERE, 0.0, 0.0, "0", False, None, 0.0)
    terrain = terrain_of(mapped, robot, FloorMemory())
    return FmmPlanner().route(terrain, terrain.disc(*THERE, 0.25), robot, CONFIG) is not None


def judge_passes(blocked):
    return judged(blocked).floors["0"].component.max() == 1


@settings(max_examples=40)
@given(seed=st.integers(0, 10_000), share=st.floats(0.002, 0.05))
def test_the_rule_is_the_distance_between_middles(seed, share):
    blocked = np.random.default_rng(seed).random((24, 30)) < share
    blocked[0, 0] = True
    cells = np.argwhere(blocked)
    at = np.argwhere(np.ones(blocked.shape, bool))
    literal = np.sqrt(((at[:, None] - cells[None]) ** 2).sum(-1).min(1)).reshape(blocked.shape)
    assert np.allclose(clearance_m(blocked, R), R * literal, atol=1e-5)
    assert np.array_equal(fits(clearance_m(blocked, R)), R * literal > RADIUS_M)


@settings(max_examples=40)
@given(seed=st.integers(0, 10_000), share=st.floats(0.002, 0.03))
def test_planner_and_judge_agree_where_the_body_is_at_ease(seed, share):
    blocked = np.random.default_rng(seed).random(GRID.shape) < share
    robot = RobotView(0, *HERE, 0.0, 0.0, "0", False, None, 0.0)
    terrain = terrain_of(blocked, robot, FloorMemory())
    rows, cols = terrain.occupied.shape
    assert (rows, cols) == GRID.shape
    at_ease = terrain.speed > CONFIG.constrained_speed
    at_ease[terrain.cell(*HERE)] = fits(terrain.clearance_m)[terrain.cell(*HERE)]  # where it stands is never blocked
    assert np.array_equal(at_ease, fits(clearance_m(blocked, R)))


@settings(max_examples=40)
@given(seed=st.integers(0, 10_000), share=st.floats(0.002, 0.03))
def test_a_map_that_spills_over_shuts_nothing_that_the_judge_counts(seed, share):
    blocked = np.random.default_rng(seed).random(GRID.shape) < share
    robot = RobotView(0, *HERE, 0.0, 0.0, "0", False, None, 0.0)
    terrain = terrain_of(spilled(blocked), robot, FloorMemory())
    assert (terrain.speed[fits(clearance_m(blocked, R))] > 0.0).all()


@pytest.mark.parametrize("cells", range(2, 12))
def test_a_corridor_is_passable_for_both_or_neither(cells):
    """By a map that spills over by a cell on both sides, exactly; by a perfect one the planner tries two cells less."""
    blocked = corridor(cells)
    assert judge_passes(blocked) == (cells >= NARROWEST)
    assert way_there(spilled(blocked)) == (cells >= NARROWEST)
    assert way_there(blocked) == (cells >= NARROWEST - 2)


@pytest.mark.parametrize("cells", [NARROWEST, NARROWEST + 1, NARROWEST + 2])
@pytest.mark.parametrize("length", [3, 20])
@pytest.mark.parametrize("spills", [False, True])
def test_the_body_gets_through_what_the_judge_counts(cells, length, spills):
    """Whatever it was turned to: twelve headings and whole steps through a place that its centre has one to three cells of."""
    blocked = corridor(cells, length)
    rng = np.random.default_rng([cells, length])
    mapped = spilled(blocked) if spills else blocked
    assert all(arrives(blocked, mapped, float(rng.uniform(-math.pi, math.pi))) for _ in range(3))
