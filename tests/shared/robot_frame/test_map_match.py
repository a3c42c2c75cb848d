"""Matching a robot's map with the joint map: right within 5 cm and 1 degree, or refused by name."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.errors import FrameError
from surveilnav.geometry import Grid
from surveilnav.robot_frame import PlanarTransform
from surveilnav.robot_frame.map_match import match_maps
from surveilnav.robot_frame.nav2_map import OCCUPIED
from tests.made_up_floors import joint_map, made_up_floor, robots_map

seeds = st.integers(0, 2**31)


def somewhere(rng):
    return PlanarTransform(rng.uniform(-20, 20), rng.uniform(-20, 20), rng.uniform(-math.pi, math.pi))


def assert_right(found, T, p_map):
    off_m, off_rad = found.T_building_map.difference(T, p_map)
    assert off_m < 0.05
    assert off_rad < math.radians(1.0)


@settings(max_examples=12, deadline=None)
@given(seeds)
def test_the_same_rooms_of_another_day(seed):
    """A fifth of the furniture is another, a fifth of the cells are missing, and the rest are noisy."""
    rng = np.random.default_rng(seed)
    floor, T = made_up_floor(rng), somewhere(rng)
    every = list(range(len(floor.rooms)))
    own = robots_map(floor, every, T, rng)
    found = match_maps(own, *joint_map(floor, every, rng))
    assert_right(found, T, own.places(OCCUPIED).mean(axis=0))
    assert found.method == "map match"
    assert found.residual_m < 0.06


@settings(max_examples=12, deadline=None)
@given(seeds)
def test_maps_that_overlap_in_part(seed):
    """Each has seen six of ten rooms or so; at least a third of each map is in the other."""
    rng = np.random.default_rng(seed)
    floor, T = made_up_floor(rng, 14.0, 10.0), somewhere(rng)
    order = rng.permutation(len(floor.rooms))
    n = len(order)
    shared = list(order[: max(4, n // 3)])
    rest = order[len(shared) :]
    own = robots_map(floor, [*shared, *rest[::2]], T, rng)
    joint = joint_map(floor, [*shared, *rest[1::2]], rng)
    assert_right(match_maps(own, *joint), T, own.places(OCCUPIED).mean(axis=0))


def symmetrical(rng):
    """A room that looks the same from both sides."""
    floor = made_up_floor(rng, 6.0, 4.0, furniture=False)
    solid = floor.solid.copy()
    solid[:] = False
    wall = 6
    solid[:wall] = solid[-wall:] = True
    solid[:, :wall] = solid[:, -wall:] = True
    rows, cols = solid.shape
    return replace(floor, solid=solid, rooms=[(wall, rows - wall, wall, cols - wall)], furniture=[])


def test_a_room_that_looks_alike_from_both_sides_is_refused():
    rng = np.random.default_rng(3)
    floor, T = symmetrical(rng), somewhere(rng)
    with pytest.raises(FrameError, match=r"turned by 180 degrees .* Rooms look alike") as caught:
        match_maps(robots_map(floor, [0], T, rng), *joint_map(floor, [0], rng))
    assert caught.value.name == "ambiguous"


def test_it_is_found_where_it_was_before():
    """Near an earlier frame the symmetrical room fits once only."""
    rng = np.random.default_rng(3)
    floor, T = symmetrical(rng), somewhere(rng)
    own, joint = robots_map(floor, [0], T, rng), joint_map(floor, [0], rng)
    middle = own.places(OCCUPIED).mean(axis=0)
    before = PlanarTransform(*(T.apply(middle) + np.array([0.3, -0.2]))) @ PlanarTransform(0, 0, T.yaw_rad + 0.08)
    before = before @ PlanarTransform(*-middle)
    assert_right(match_maps(own, *joint, near=before), T, middle)


@pytest.mark.parametrize("seed", range(6))
def test_maps_of_different_floors_are_refused(seed):
    rng = np.random.default_rng(seed)
    one, other = made_up_floor(rng), made_up_floor(rng)
    own = robots_map(one, list(range(len(one.rooms))), somewhere(rng), rng)
    with pytest.raises(FrameError) as caught:
        match_maps(own, *joint_map(other, list(range(len(other.rooms))), rng))
    assert caught.value.name in ("no_match", "ambiguous", "too_little_overlap")


def test_a_map_that_shows_nothing_is_refused():
    rng = np.random.default_rng(5)
    floor = made_up_floor(rng)
    own = robots_map(floor, [0], PlanarTransform(), rng)
    grid = Grid(0, 0, 0.05, 100, 100)
    nothing = np.zeros(grid.shape, np.uint8)
    with pytest.raises(FrameError, match="the joint map shows hardly any obstacle") as caught:
        match_maps(own, grid, nothing, nothing)
    assert caught.value.name == "too_little_overlap"
