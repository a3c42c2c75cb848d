"""DBSCAN against scikit-learn's."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.cluster import DBSCAN

from surveilnav.services.fusion.core.objects.clustering import dbscan, largest_cluster


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("eps_m", "min_points"), [(0.05, 10), (0.1, 5), (0.02, 3)])
def test_equals_scikit_learn(seed, eps_m, min_points):
    rng = np.random.default_rng(seed)
    blobs = [rng.normal(rng.uniform(0, 0.6, 3), rng.uniform(0.01, 0.06), (rng.integers(5, 120), 3)) for _ in range(5)]
    points = np.concatenate([*blobs, rng.uniform(0, 0.6, (40, 3))]).astype(np.float32)
    expected = DBSCAN(eps=eps_m, min_samples=min_points).fit_predict(points.astype(np.float64))
    np.testing.assert_array_equal(dbscan(points, eps_m, min_points), expected)


@pytest.mark.parametrize("extent_m", [0.0, 0.04, 300.0])
@pytest.mark.parametrize("axis", range(3))
def test_equals_scikit_learn_however_the_points_lie(axis, extent_m):
    """All in one cell of the grid, in one row of it, and far apart."""
    rng = np.random.default_rng(axis)
    points = rng.uniform(0, 0.1, (300, 3))
    points[:, axis] = rng.integers(0, 5, 300) * extent_m / 5
    points = points.astype(np.float32)
    expected = DBSCAN(eps=0.02, min_samples=4).fit_predict(points.astype(np.float64))
    np.testing.assert_array_equal(dbscan(points, 0.02, 4), expected)


def core_points(points, eps_m, min_points):
    """Literal: all pairs, in float32 as the code has them."""
    d = points[:, None] - points[None]
    near = (d * d).sum(axis=2, dtype=np.float32) <= np.float32(eps_m) * np.float32(eps_m)
    return near.sum(axis=1) >= min_points


def test_a_pair_that_is_just_in_reach_counts_whatever_cells_it_lies_in():
    at = np.arange(40, dtype=np.float32) * np.float32(0.05) + np.float32(7.3)
    points = np.stack([np.repeat(at, 40), np.tile(at, 40), np.zeros(1600, np.float32)], axis=1)
    core = core_points(points, 0.05, 2)
    assert 0.2 < core.mean() < 1.0, "rounding decides"
    np.testing.assert_array_equal(dbscan(points, 0.05, 2) >= 0, core)


def test_background_that_leaked_into_a_mask_goes():
    rng = np.random.default_rng(0)
    chair = rng.uniform(0, 0.3, (200, 3))
    wall = rng.uniform(0, 0.2, (80, 3)) + np.array([0, 0, 2])
    kept = largest_cluster(np.concatenate([wall, chair]).astype(np.float32), 0.08, 5)
    assert set(kept) <= set(range(80, 280))
    assert len(kept) > 190


@pytest.mark.parametrize("n", [0, 1, 9])
def test_too_few_points_are_noise(n):
    assert len(largest_cluster(np.zeros((n, 3), np.float32), 0.05, 10)) == 0
