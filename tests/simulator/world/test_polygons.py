from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.simulator.world.polygons import contains, ear_clip, intersect_convex, signed_area, subtract


def star(radii: list[float]) -> np.ndarray:
    """A star-shaped polygon: simple, and concave wherever neighbouring radii differ enough."""
    angles = np.arange(len(radii)) * 2 * math.pi / len(radii)
    return np.column_stack([np.array(radii) * np.cos(angles), np.array(radii) * np.sin(angles)])


stars = st.lists(st.floats(0.2, 3.0), min_size=3, max_size=24).map(star)
positions = st.tuples(st.floats(-3, 3), st.floats(-3, 3))


@given(stars, st.booleans())
def test_ear_clipping_fills_exactly_the_polygon(polygon: np.ndarray, clockwise: bool) -> None:
    ring = polygon[::-1] if clockwise else polygon
    areas = [signed_area(ring[t]) for t in ear_clip(ring)]
    assert sum(areas) == pytest.approx(signed_area(ring), rel=1e-6, abs=1e-9)
    # Wound alike and without overlap: no triangle has the other sign.
    assert all(a * signed_area(ring) >= -1e-9 for a in areas)


def test_a_frame_is_not_filled_by_a_fan() -> None:
    # A door frame, U-shaped: a fan from its first corner would close the opening.
    frame = np.array([[0, 0], [0.1, 0], [0.1, 1.9], [0.9, 1.9], [0.9, 0], [1, 0], [1, 2], [0, 2]], dtype=float)
    triangles = ear_clip(frame)
    middle = np.array([0.5, 1.0])
    assert not any(contains(frame[t], middle) for t in triangles)
    assert sum(abs(signed_area(frame[t])) for t in triangles) == pytest.approx(2 - 0.8 * 1.9)


@given(stars, stars, positions)
def test_subtraction_leaves_what_is_inside_one_and_outside_the_other(
    polygon: np.ndarray, hole: np.ndarray, p: tuple[float, float]
) -> None:
    pieces = subtract(polygon, [hole])
    point = np.array(p)
    near_an_edge = any(
        abs(signed_area(np.array([a, b, point]))) < 1e-3 * (1 + np.linalg.norm(b - a))
        for ring in (polygon, hole)
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True)
    )
    near_a_cut = any(
        abs(signed_area(np.array([a, b, point]))) < 1e-6
        for ring in pieces
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True)
    )
    if not near_an_edge and not near_a_cut:
        expected = contains(polygon, point) and not contains(hole, point)
        assert any(contains(piece, point) for piece in pieces) == expected


def test_convex_intersection_of_two_squares() -> None:
    square = np.array([[0, 0], [2, 0], [2, 2], [0, 2]], dtype=float)
    assert signed_area(intersect_convex(square, square + 1)) == pytest.approx(1.0)
    assert signed_area(intersect_convex(square, (square + 1)[::-1])) == pytest.approx(1.0)
    assert len(intersect_convex(square, square + 5)) == 0
