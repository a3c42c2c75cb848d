"""Eq. 3: geometric and semantic similarity."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from surveilnav.services.fusion.core.objects.association import box_iou, box_overlap, cosine, overlaps, voxel_iou
from surveilnav.services.fusion.core.objects.shape import Shape

points = hnp.arrays(np.float64, st.tuples(st.integers(1, 40), st.just(3)), elements=st.floats(-0.25, 0.25))


def shape(p):
    return Shape.from_points(np.asarray(p, float), 0.025, 0.05)


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


@pytest.mark.parametrize(
    ("name", "a", "b", "box", "voxel", "overlap"),
    [
        ("the same", block(0, 0, 0, 0.4, 0.4, 0.4), block(0, 0, 0, 0.4, 0.4, 0.4), (1, 1), (1, 1), (1, 1)),
        ("far apart", block(0, 0, 0, 0.4, 0.4, 0.4), block(2, 0, 0, 0.4, 0.4, 0.4), (0, 0), (0, 0), (0, 0)),
        ("two halves", block(0, 0, 0, 0.2, 0.4, 0.4), block(0.2, 0, 0, 0.2, 0.4, 0.4), (0, 0.1), (0, 0.1), (0.2, 0.4)),
        ("a part", block(0, 0, 0, 0.2, 0.4, 0.4), block(0, 0, 0, 0.8, 0.4, 0.4), (0.2, 0.3), (0.2, 0.3), (1, 1)),
    ],
)
def test_table(name, a, b, box, voxel, overlap):
    assert box[0] <= box_iou(a, b) <= box[1] + 1e-9
    assert voxel[0] <= voxel_iou(a, b) <= voxel[1] + 1e-9
    assert overlap[0] <= max(overlaps(a, b)) <= overlap[1]


def test_cosine_of_what_cannot_be_compared_is_0():
    assert cosine(np.ones(3), np.ones(4)) == 0
    assert cosine(np.zeros(3), np.ones(3)) == 0
    assert cosine(np.array([3.0, 0]), np.array([1.0, 1])) == pytest.approx(0.5**0.5)
