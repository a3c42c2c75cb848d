"""DBSCAN against scikit-learn's."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.cluster import DBSCAN

from services.fusion.core.clustering import dbscan, largest_cluster


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("eps_m", "min_points"), [(0.05, 10), (0.1, 5), (0.02, 3)])
def test_equals_scikit_learn(seed, eps_m, min_points):
    rng = np.random.default_rng(seed)
    blobs = [rng.normal(rng.uniform(0, 0.6, 3), rng.uniform(0.01, 0.06), (rng.integers(5, 120), 3)) for _ in range(5)]
    points = np.concatenate([*blobs, rng.uniform(0, 0.6, (40, 3))]).astype(np.float32)
    expected = DBSCAN(eps=eps_m, min_samples=min_points).fit_predict(points.astype(np.float64))
    np.testing.assert_array_equal(dbscan(points, eps_m, min_points), expected)


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
