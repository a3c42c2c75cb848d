"""Clouds for people: few points, spread evenly."""

from __future__ import annotations

import numpy as np
import pytest

from surveilnav.services.gateway.core.clouds import thinned

CLOUD = np.random.default_rng(0).random((5000, 6), np.float32) * np.array([8, 6, 2.5, 1, 1, 1], np.float32)


@pytest.mark.parametrize("most", [1, 50, 1000, 4999])
def test_few_points_of_the_cloud_itself_whatever_their_order(most):
    few = thinned(CLOUD, most)
    assert most / 8 < len(few) <= most
    rows = {row.tobytes() for row in CLOUD}
    assert all(row.tobytes() in rows for row in few)
    shuffled = np.random.default_rng(1).permutation(CLOUD)
    assert np.array_equal(thinned(shuffled, most), few)


def test_they_are_spread_evenly():
    crowded = np.concatenate([CLOUD[:500], np.full((50_000, 6), 0.5, np.float32) + CLOUD[:1] * 1e-6])
    few = thinned(crowded, 600)
    assert len(few) > 400, "a crowd of points takes the room of one"


def test_what_fits_is_whole_and_what_is_no_place_is_left_out():
    odd = CLOUD[:4].copy()
    odd[0, 0], odd[1, 2], odd[2, 4] = np.nan, 1e30, np.inf
    assert np.array_equal(thinned(odd, 10), CLOUD[3:4])
    assert thinned(np.zeros((0, 6), np.float32), 10).shape == (0, 6)
