from __future__ import annotations

import math

import numpy as np
import pytest

from surveilnav.simulator.furniture.parametric import stair_flight
from surveilnav.simulator.plans.stairs import find_transit, treads
from surveilnav.simulator.world.assembly import Mesh, MeshBuilder
from surveilnav.simulator.world.scene import Material

GREY = Material("grey", (0.5, 0.5, 0.5))


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    mesh = MeshBuilder()
    mesh.box(low, high, GREY)
    return mesh.mesh()


def turned(angle: float, x: float = 0.0, y: float = 0.0) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]])


def anywhere(_: np.ndarray) -> bool:
    return True


def test_treads_are_counted_from_below() -> None:
    steps = treads(stair_flight(0.9, 2.4, 2.62, 12), 0.0, 2.62)
    assert len(steps) == 12
    np.testing.assert_allclose(steps[0], (0.1, 0.0, 2.62 / 12), atol=1e-5)
    np.testing.assert_allclose(steps[-1], (2.3, 0.0, 2.62), atol=1e-5)


@pytest.mark.parametrize("angle", [0.0, 0.7, math.pi / 2, 3.0])
def test_one_steps_on_before_the_first_and_off_after_the_last_tread(angle: float) -> None:
    T = turned(angle, 3.0, -1.0)
    flight = stair_flight(0.9, 2.4, 2.62, 12).moved(T)
    stair = find_transit(flight, [flight], ("0", 0.0), ("1", 2.62), (anywhere, anywhere))
    assert stair is not None
    back = np.linalg.inv(T)
    lower = (back @ np.array([*stair.lower_m, 1]))[:3]
    upper = (back @ np.array([*stair.upper_m, 1]))[:3]
    assert -1.0 < lower[0] < -0.2
    assert 2.6 < upper[0] < 3.4
    assert abs(lower[1]) < 0.01
    assert abs(upper[1]) < 0.01
    assert (lower[2], upper[2]) == pytest.approx((0.0, 2.62))
    steps_m = math.hypot(2.2, 2.62 * 11 / 12)
    assert stair.length_m == pytest.approx(steps_m + math.hypot(0.1 - lower[0], 2.62 / 12) + upper[0] - 2.3, abs=0.02)


def test_a_wall_ahead_turns_the_way_aside() -> None:
    flight = stair_flight(0.9, 2.4, 2.62, 12)
    wall = box((2.75, -2.0, 2.62), (2.85, 2.0, 5.0))
    stair = find_transit(flight, [flight, wall], ("0", 0.0), ("1", 2.62), (anywhere, anywhere))
    assert stair is not None
    x, y, _ = stair.upper_m
    assert x < 2.75 - 0.25
    assert math.hypot(x - 2.3, y) < 1.6


def test_there_must_be_floor_where_one_steps_off() -> None:
    flight = stair_flight(0.9, 2.4, 2.62, 12)
    stair = find_transit(flight, [flight], ("0", 0.0), ("1", 2.62), (anywhere, lambda p: bool(p[1] > 0.3)))
    assert stair is not None
    assert stair.upper_m[1] > 0.3


def test_a_box_is_no_staircase() -> None:
    thing = box((0, 0, 0), (1, 1, 1))
    assert find_transit(thing, [thing], ("0", 0.0), ("1", 2.62), (anywhere, anywhere)) is None
