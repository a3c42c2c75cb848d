"""Eq. 3: geometric and semantic similarity."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from services.fusion.core.association import BoxTable, Shape, box_iou, box_overlap, cosine, evenly, overlaps, voxel_iou
from services.fusion.core.cloud import voxel_centres, voxel_keys
from surveilnav.geometry import camera_pose

points = hnp.arrays(np.float64, st.tuples(st.integers(1, 40), st.just(3)), elements=st.floats(-0.25, 0.25))


def shape(p):
    return Shape.of_points(np.asarray(p, float), 0.025, 0.05)


def block(x, y, z, sx, sy, sz):
    """A solid block of points every 2 cm, from its low corner."""
    axes = [np.arange(o + 0.01, o + s, 0.02) for o, s in ((x, sx), (y, sy), (z, sz))]
    return shape(np.array(list(itertools.product(*axes))))


def cells(p, size):
    return {tuple(c) for c in np.floor(np.asarray(p) / size).astype(int).tolist()}


@given(points, points)
def test_against_the_definitions(p, q):
    a, b = shape(p), shape(q)
    fine_a, fine_b = cells(p, 0.025), cells(q, 0.025)
    assert voxel_iou(a, b) == pytest.approx(len(fine_a & fine_b) / len(fine_a | fine_b))
    low, high = (np.array([f(c, axis=0) for f in (np.min, np.max)]) for c in (list(fine_a), list(fine_b)))
    box_a, box_b = (np.stack([c[0], c[1] + 1]) * 0.025 for c in (low, high))
    inside = np.prod(np.clip(np.minimum(box_a[1], box_b[1]) - np.maximum(box_a[0], box_b[0]), 0, None))
    both = np.prod(box_a[1] - box_a[0]) + np.prod(box_b[1] - box_b[0]) - inside
    assert box_iou(a, b) == pytest.approx(inside / both, abs=1e-6)
    coarse_a, coarse_b = cells(a.points, 0.05), cells(b.points, 0.05)

    def share(one, other):
        around = {tuple(np.add(c, d)) for c in other for d in itertools.product((-1, 0, 1), repeat=3)}
        return len(one & around) / len(one)

    assert overlaps(a, b) == pytest.approx((share(coarse_a, coarse_b), share(coarse_b, coarse_a)))
    smaller = min(np.prod(box[1] - box[0]) for box in (box_a, box_b))
    assert box_overlap(a, b) == pytest.approx(inside / smaller, abs=1e-6)


@given(points)
def test_keys_round_trip(p):
    keys = voxel_keys(p, 0.025)
    centres = voxel_centres(keys, 0.025)
    assert cells(centres, 0.025) == cells(p, 0.025)
    np.testing.assert_array_equal(voxel_keys(centres, 0.025), keys)
    assert np.all(np.diff(keys) > 0)


@pytest.mark.parametrize(
    ("name", "a", "b", "box", "voxel", "overlap"),
    [
        ("the same", block(0, 0, 0, 0.4, 0.4, 0.4), block(0, 0, 0, 0.4, 0.4, 0.4), (1, 1), (1, 1), (1, 1)),
        ("far apart", block(0, 0, 0, 0.4, 0.4, 0.4), block(2, 0, 0, 0.4, 0.4, 0.4), (0, 0), (0, 0), (0, 0)),
        ("two halves", block(0, 0, 0, 0.2, 0.4, 0.4), block(0.2, 0, 0, 0.2, 0.4, 0.4), (0, 0.1), (0, 0.1), (0.2, 0.4)),
        ("a part", block(0, 0, 0, 0.2, 0.4, 0.4), block(0, 0, 0, 0.8, 0.4, 0.4), (0.2, 0.3), (0.2, 0.3), (1, 1)),
    ],
)  # fmt: skip
def test_table(name, a, b, box, voxel, overlap):
    assert box[0] <= box_iou(a, b) <= box[1] + 1e-9
    assert voxel[0] <= voxel_iou(a, b) <= voxel[1] + 1e-9
    assert overlap[0] <= max(overlaps(a, b)) <= overlap[1]


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
    np.testing.assert_array_equal(evenly(5, 64), np.arange(5))
    assert (evenly(1000, 3) == (0, 500, 999)).all() or (evenly(1000, 3) == (0, 499, 999)).all()


@given(st.lists(st.tuples(st.sampled_from(["put", "drop"]), st.integers(1, 30), points), max_size=60), points)
def test_the_table_of_boxes_finds_what_a_loop_finds(story, p):
    table, shapes = BoxTable(), {}
    for what, id_, q in story:
        if what == "put":
            shapes[id_] = shape(q + id_ % 5 * 0.3)
            table.put(id_, shapes[id_])
        elif id_ in shapes:
            del shapes[id_]
            table.drop(id_)
    a = shape(p)
    near = [i for i, s in shapes.items() if np.all(s.p_min <= a.p_max + 0.1) and np.all(s.p_max >= a.p_min - 0.1)]
    assert table.touching(a, 0.1) == sorted(near)
    T = camera_pose((0.1, 0.2, 0.3), 0.7, -0.2)
    before = []
    for i, s in shapes.items():
        d = (s.p_min + s.p_max) / 2 - T[:3, 3]
        if d @ T[:3, 2] > 0 and np.linalg.norm(d) <= 0.8:
            before.append(i)
    assert table.before(T, 0.8) == sorted(before)


def test_cosine_of_what_cannot_be_compared_is_0():
    assert cosine(np.ones(3), np.ones(4)) == 0
    assert cosine(np.zeros(3), np.ones(3)) == 0
    assert cosine(np.array([3.0, 0]), np.array([1.0, 1])) == pytest.approx(0.5**0.5)
