from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.errors import BuildingError
from surveilnav.geometry import Grid
from surveilnav.simulator.plans.ground import MAX_PARTS, find_ground, inside
from surveilnav.simulator.world.polygons import contains, signed_area


def box(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def turned(polygon: np.ndarray, angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return polygon @ np.array([[c, s], [-s, c]])


def ring(x0: float, y0: float, x1: float, y1: float, t: float = 0.2, gap_m: float = 0.0) -> list[np.ndarray]:
    """Four walls with their inner faces on the box; the lower one has a gap in its middle."""
    middle, lower = (x0 + x1) / 2, (y0 - t, y0)
    walls = [box(x0 - t, y1, x1 + t, y1 + t), box(x0 - t, y0 - t, x0, y1 + t), box(x1, y0 - t, x1 + t, y1 + t)]
    if gap_m == 0:
        return [*walls, box(x0 - t, lower[0], x1 + t, lower[1])]
    halves = (x0 - t, middle - gap_m / 2), (middle + gap_m / 2, x1 + t)
    return [*walls, *(box(a, lower[0], b, lower[1]) for a, b in halves)]


@given(
    corners=st.lists(st.floats(0.3, 3.0), min_size=3, max_size=12),
    shift=st.tuples(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05)),
)
def test_cells_are_inside_by_their_centres(corners: list[float], shift: tuple[float, float]) -> None:
    angles = np.arange(len(corners)) * 2 * math.pi / len(corners)
    polygon = np.column_stack([np.array(corners) * np.cos(angles), np.array(corners) * np.sin(angles)]) + shift
    grid = Grid(-3.5, -3.5, 0.05, 140, 140)
    cells = inside([polygon], grid)
    for row, col in np.ndindex(14, 14):
        here = (row * 10 + 3, col * 10 + 7)
        assert cells[here] == contains(polygon, grid.centres_of(here))


@given(
    width=st.floats(1.5, 8),
    depth=st.floats(1.5, 8),
    angle=st.floats(0, math.pi),
    gap_m=st.sampled_from([0.0, 0.9, 2.0]),
)
@settings(max_examples=30)
def test_the_floor_between_walls_is_laid_and_none_outside(
    width: float, depth: float, angle: float, gap_m: float
) -> None:
    gap_m = min(gap_m, 0.4 * width)
    walls = [turned(w, angle) for w in ring(0, 0, width, depth, gap_m=gap_m)]
    (area,) = find_ground(walls, [])
    assert area.is_area
    assert area.area_m2 == pytest.approx(width * depth, rel=0.06, abs=0.1 + 0.3 * gap_m)
    corners = np.concatenate([turned(tile, -angle) for tile in area.tiles])
    assert corners.min() > -0.3  # half a wall's thickness and some cells
    assert (corners.max(axis=0) < np.array([width, depth]) + 0.3).all()
    laid = sum(signed_area(tile) for tile in area.tiles)  # no two overlap: they fill a ring of cells more
    assert area.area_m2 < laid < area.area_m2 + 0.15 * (width + depth + gap_m) * 2


def test_rooms_and_voids_are_left_out_and_a_strip_is_no_area() -> None:
    walls = ring(0, 0, 6, 4)
    assert [part.area_m2 for part in find_ground(walls, [box(0, 0, 6, 4)])] == []
    (left,) = find_ground(walls, [box(0, 0, 4, 4)])
    assert (left.area_m2, left.is_area) == (pytest.approx(8.0, abs=0.2), True)
    (strip,) = find_ground(walls, [box(0, 0, 5.9, 4)])
    assert (strip.area_m2, strip.is_area) == (pytest.approx(0.4, abs=0.01), False)


def test_a_courtyard_open_to_the_street_is_none_of_the_building() -> None:
    solid = [*ring(0, 0, 12, 3), *ring(0, 3.2, 3, 9), *ring(9, 3.2, 12, 9)]  # a U around a court of 6 x 6 m
    areas = [part for part in find_ground(solid, []) if part.is_area]
    assert len(areas) == 3
    assert not any(contains(part.outline, np.array([6.0, 6.0])) for part in areas)


def test_a_plan_too_large_or_without_walls_gets_none() -> None:
    assert find_ground([], []) == ()
    assert find_ground([], [box(0, 0, 1, 1)]) == ()


def test_large_storeys_are_filled_by_larger_cells_and_too_large_ones_refused() -> None:
    for side in (90.0, 150.0, 350.0):
        (part,) = find_ground(ring(0, 0, side, side), [])
        assert part.area_m2 == pytest.approx(side**2, rel=0.01)
    with pytest.raises(BuildingError, match="450 x 450 m, too much"):
        find_ground(ring(0, 0, 450, 450), [])


def test_a_lattice_of_walls_gives_no_more_parts_than_the_limit() -> None:
    bars = [box(x, 0, x + 0.2, 40) for x in np.arange(0, 40, 0.8)]
    bars += [box(0, y, 40, y + 0.2) for y in np.arange(0, 40, 0.8)]
    assert len(find_ground(bars, [])) == MAX_PARTS
