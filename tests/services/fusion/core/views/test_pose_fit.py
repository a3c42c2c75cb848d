"""How well points fit, against a slow reference; and that a known turn and shift are found."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.services.fusion.core.views.pose_fit import (
    _box,
    _Layers,
    _mean_around,
    _near_box,
    fit_pose,
    points_to_fit,
)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 4), st.integers(1, 30))
def test_the_mean_of_shifted_cells_is_as_said_word_for_word(seed, n, n_points):
    """Points near and beyond the edge, too: there the cell at the edge counts."""
    rng = np.random.default_rng(seed)
    near = rng.random((2, 9, 9), np.float32)
    layer = rng.integers(0, 2, n_points)
    row, col = rng.integers(-6, 15, (2, n_points))
    expected = np.zeros((2 * n + 1, 2 * n + 1))
    for i in range(-n, n + 1):
        for j in range(-n, n + 1):
            at = layer, np.clip(row + i, 0, 8), np.clip(col + j, 0, 8)
            expected[i + n, j + n] = near[at].astype(np.float64).mean()
    assert _mean_around(near, layer, row, col, n) == pytest.approx(expected, abs=1e-5)


def walls(rng, n, x0, y0, x1, y1):
    """(n, 3) points on the four walls of a room."""
    t, side = rng.random(n), rng.integers(0, 4, n)
    x = np.where(side < 2, x0 + (x1 - x0) * t, np.where(side == 2, x0, x1))
    y = np.where(side >= 2, y0 + (y1 - y0) * t, np.where(side == 0, y0, y1))
    return np.column_stack([x, y, 2.4 * rng.random(n)])


@pytest.mark.parametrize(("yaw_deg", "x_m", "y_m"), [(0.0, 0.0, 0.0), (3.0, 0.3, -0.2), (-8.0, 0.65, 0.4)])
def test_a_known_turn_and_shift_are_found(yaw_deg, x_m, y_m):
    rng, yaw_rad = np.random.default_rng(0), math.radians(yaw_deg)
    others = np.vstack([walls(rng, 8000, -4, -3, 4, 3), walls(rng, 3000, -1, 0, 1, 1.5), walls(rng, 6000, 4, -3, 9, 4)])
    mine = points_to_fit(others, np.zeros(2), 0.0) + rng.normal(0, 0.02, (1500, 3))
    back = np.array([[math.cos(yaw_rad), -math.sin(yaw_rad)], [math.sin(yaw_rad), math.cos(yaw_rad)]])
    mine[:, :2] = (mine[:, :2] - [x_m, y_m]) @ back
    found = fit_pose(mine, others, np.zeros(2), 0.0)
    assert found is not None
    assert found.yaw_rad == pytest.approx(yaw_rad, abs=math.radians(0.5))
    assert (found.x_m, found.y_m) == (pytest.approx(x_m, abs=0.04), pytest.approx(y_m, abs=0.04))
    assert found.is_clear == (yaw_deg != 0.0)
    assert (found.described_score == found.score) == (yaw_deg == 0.0)


@pytest.mark.parametrize("seed", range(4))
def test_what_lies_too_far_away_to_count_changes_no_score(seed):
    """Others' points that are far from all places where a point of one's own may come to lie are left out of the fine layers."""
    rng, p, yaws, n = np.random.default_rng(seed), np.zeros(2), np.radians([-2.0, 0.0, 1.0]), 6
    others = np.vstack([walls(rng, 500, -1 - k, -1 - k, 1 + k, 1 + k) for k in np.arange(0.0, 2.0, 0.1)])
    others = others[others[:, 2] > 0.2]
    mine = walls(rng, 300, -1, -1, 1, 1) + np.array([0.3, 0.1, 0.0])
    near = _near_box(others, _box(mine, p, yaws, n * 0.025), 0.05)
    assert len(near) < len(others)
    all_scores, scores = (_Layers(o, p, 4.0, 0.0, 0.025, 0.05).scores(mine, yaws, 0, 0, n) for o in (others, near))
    assert np.array_equal(scores, all_scores)


def test_too_few_points_are_no_answer():
    few = walls(np.random.default_rng(0), 200, -4, -3, 4, 3)
    assert fit_pose(few, few, np.zeros(2), 0.0) is None
