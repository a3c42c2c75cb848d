"""A frame from pairs of places: exact without errors, robust to one gross error, and refused where pairs don't determine it."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from surveilnav.errors import FrameError
from surveilnav.robot_frame import PlanarTransform, from_point_pairs

transforms = st.builds(PlanarTransform, st.floats(-50, 50), st.floats(-50, 50), st.floats(-math.pi, math.pi))
SQUARE = np.array([[0.0, 0.0], [6.0, 0.5], [5.0, 4.0], [-1.0, 5.0], [2.5, 2.0]])


def spread(p):
    return np.linalg.norm(p[:, None] - p[None], axis=-1)


@given(transforms, st.integers(2, 8), st.integers(0, 2**31))
def test_without_errors_it_is_exact(T, n, seed):
    p_map = np.random.default_rng(seed).uniform(-10, 10, (n, 2))
    assume(spread(p_map).max() > 1.0)
    found = from_point_pairs(T.apply(p_map), p_map)
    assert found.T_building_map.difference(T, p_map[0]) == pytest.approx((0, 0), abs=1e-6)
    assert found.residual_m == pytest.approx(0, abs=1e-6)
    assert (found.n_constraints, found.left_out, found.method) == (n, (), "point pairs")


@given(transforms, st.integers(0, 2**31))
def test_errors_of_measuring_average_out(T, seed):
    rng = np.random.default_rng(seed)
    found = from_point_pairs(T.apply(SQUARE) + rng.normal(0, 0.03, SQUARE.shape), SQUARE)
    off_m, off_rad = found.T_building_map.difference(T, SQUARE.mean(axis=0))
    assert off_m < 0.08
    assert off_rad < math.radians(2)
    assert not found.left_out


@settings(max_examples=200)
@given(transforms, st.integers(4, 7), st.integers(0, 2**31), st.floats(0.6, 30), st.floats(-math.pi, math.pi))
def test_of_four_pairs_or_more_one_may_be_wrong(T, n, seed, off_m, towards):
    rng = np.random.default_rng(seed)
    p_map = np.concatenate([SQUARE, SQUARE + np.array([9, 3])])[:n] + rng.normal(0, 0.02, (n, 2))
    p_building, wrong = T.apply(p_map) + rng.normal(0, 0.02, (n, 2)), int(rng.integers(n))
    p_building[wrong] += off_m * np.array([math.cos(towards), math.sin(towards)])
    found = from_point_pairs(p_building, p_map)
    assert found.left_out == (wrong + 1,)
    assert f"Pair {wrong + 1} contradicts" in found.sentence
    at_m, at_rad = found.T_building_map.difference(T, p_map.mean(axis=0))
    assert at_m < 0.1
    assert at_rad < math.radians(2)


def test_two_pairs_say_that_only_their_distance_was_checked():
    found = from_point_pairs([[1, 1], [1, 5.1]], [[0, 0], [4, 0]])
    assert found.T_building_map.yaw_rad == pytest.approx(math.pi / 2)
    assert "only their distance could be checked: it differs by 0.10 m. Add a third pair" in found.sentence


def test_places_near_each_other_leave_the_turn_uncertain():
    p = np.array([[0, 0], [1, 0], [0, 1.0]])
    assert "uncertain by about" in from_point_pairs(p, p).sentence
    assert "uncertain" not in from_point_pairs(6 * p, 6 * p).sentence


@pytest.mark.parametrize(
    ("p_building", "p_map", "name", "message"),
    [
        ([[0, 0]], [[0, 0]], "undetermined", "needs 2 pairs of places, and is good from 3 on.*got 1"),
        ([[0, 0], [1, 1]], [[0, 0]], "undetermined", "as many finite places"),
        ([[0, 0], [1, math.nan]], [[0, 0], [1, 1]], "undetermined", "finite places"),
        ([[0, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0]], "undetermined", r"places \(x, y\)"),
        (
            [[1, 1], [1.1, 1], [1, 1.1]],
            [[0, 0], [1, 0], [0, 1]],
            "undetermined",
            "within 0.14 m in the building.*turned in any",
        ),
        ([[0, 0], [1, 0], [0, 1]], [[2, 2], [2, 2], [2, 2]], "undetermined", "within 0.00 m in the map"),
        ([[0, 0], [4, 0]], [[0, 0], [3, 0]], "contradictory", "4.00 m apart in the building and 3.00 m in the map"),
        ([[0, 0], [4, 0], [0, 4]], [[0, 0], [4, 0], [3, 1]], "contradictory", "add a fourth pair"),
        (
            [[0, 0], [4, 0], [0, 4], [4, 4], [2, 7]],
            [[0, 0], [4, 2], [0, 4], [2, 4], [2, 2]],
            "contradictory",
            "on average, pair . most",
        ),
        (SQUARE * (1, -1), SQUARE, "mirrored", "seen in a mirror"),
        (SQUARE[:3, ::-1], SQUARE[:3], "mirrored", "x and y are exchanged"),
    ],
)
def test_pairs_that_determine_nothing(p_building, p_map, name, message):
    with pytest.raises(FrameError, match=message) as caught:
        from_point_pairs(p_building, p_map)
    assert caught.value.name == name


def test_of_two_suspects_neither_is_condemned():
    """Two places near each other and two far away, each on a line with them: whichever far one is left out, the others agree."""
    p_map = np.array([[0, 0], [0.4, 0.0], [10.0, 0.5], [0.5, 10.0]])
    turned = PlanarTransform(0, 0, math.radians(8)).apply(p_map)
    with pytest.raises(FrameError, match="either pair 3 or pair 4 is wrong") as caught:
        from_point_pairs([*p_map[:3], turned[3]], p_map)
    assert caught.value.pairs == (3, 4)
