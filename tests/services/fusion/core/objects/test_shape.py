"""The voxels of detections and objects."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from surveilnav.services.fusion.core.maps.cloud import voxel_centres, voxel_keys
from surveilnav.services.fusion.core.objects.shape import Shape, spread_indices

points = hnp.arrays(np.float64, st.tuples(st.integers(1, 40), st.just(3)), elements=st.floats(-0.25, 0.25))


def shape(p):
    return Shape.from_points(np.asarray(p, float), 0.025, 0.05)


def block(x, y, z, sx, sy, sz):
    """A solid block of points every 2 cm, from its low corner."""
    axes = [np.arange(o + 0.01, o + s, 0.02) for o, s in ((x, sx), (y, sy), (z, sz))]
    return shape(np.array(list(itertools.product(*axes))))


def cells(p, size):
    return {tuple(c) for c in np.floor(np.asarray(p) / size).astype(int).tolist()}


@given(points)
def test_keys_round_trip(p):
    keys = voxel_keys(p, 0.025)
    centres = voxel_centres(keys, 0.025)
    assert cells(centres, 0.025) == cells(p, 0.025)
    np.testing.assert_array_equal(voxel_keys(centres, 0.025), keys)
    assert np.all(np.diff(keys) > 0)


def test_union_keeps_what_is_there_and_stops_at_the_limit():
    a, b = block(0, 0, 0, 0.2, 0.2, 0.2), block(0.1, 0, 0, 0.2, 0.2, 0.2)
    both = a.union(b, 10_000)
    assert set(both.keys) == set(a.keys) | set(b.keys)
    assert np.all(np.diff(both.keys) > 0)
    capped = a.union(b, len(a.keys) + 5)
    assert len(capped.keys) == len(a.keys) + 5
    assert set(a.keys) < set(capped.keys)


@given(points, points)
def test_a_union_is_what_its_voxels_make(p, q):
    a, b = shape(p), shape(q)
    both, whole = a.union(b, 10_000), shape(np.concatenate([p, q]))
    np.testing.assert_array_equal(both.keys, whole.keys)
    np.testing.assert_array_equal(both.coarse, whole.coarse)
    np.testing.assert_array_equal([both.p_min, both.p_max], [whole.p_min, whole.p_max])


def test_samples_are_some_of_the_points_and_evenly_spaced():
    whole = block(0, 0, 0, 0.4, 0.4, 0.4)
    assert len(whole.points) > 64
    assert {tuple(p) for p in whole.samples} < {tuple(p) for p in whole.points}
    assert len(whole.samples) == 64
    np.testing.assert_array_equal(spread_indices(5, 64), np.arange(5))
    assert (spread_indices(1000, 3) == (0, 500, 999)).all() or (spread_indices(1000, 3) == (0, 499, 999)).all()
