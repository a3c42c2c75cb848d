"""A map as it grew: what the page undoes is what was written, and moments meet on one grid."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from surveilnav.cli.report import MapMoment
from surveilnav.cli.report.cell_changes import changed, changes, growing_map, states_of
from surveilnav.geometry import Grid

SHAPES = array_shapes(min_dims=2, max_dims=2, max_side=40)
STATES = st.integers(0, 2)


@given(
    SHAPES.flatmap(
        lambda shape: st.tuples(arrays(np.uint8, shape, elements=STATES), arrays(np.uint8, shape, elements=STATES))
    )
)
def test_changes_and_back(pair):
    before, after = pair
    assert np.array_equal(changed(before, changes(before, after)), after)
    assert changes(after, after) == b""


def test_long_runs_take_few_bytes():
    before, after = np.zeros((300, 300), np.uint8), np.ones((300, 300), np.uint8)
    assert len(changes(before, after)) <= 5
    assert np.array_equal(changed(before, changes(before, after)), after)


def moment(seq: int, grid: Grid, *known: tuple[int, int, int]) -> MapMoment:
    cells = np.zeros(grid.shape, np.uint8)
    for row, col, state in known:
        cells[row, col] = state
    return MapMoment(seq, "0", grid, MapMoment.pack(cells))


def test_moments_on_a_map_that_grew_lie_where_they_lay():
    """Whichever grid a moment had: a cell that was known lies at the same place of the world."""
    small, large = Grid(0.0, 0.0, 0.05, 20, 30), Grid(-0.5, -0.25, 0.05, 60, 80)
    grown = growing_map([moment(3, small, (4, 7, 2)), moment(9, large, (9, 17, 2), (50, 70, 1))])
    assert grown is not None
    first, last = grown.at(3), grown.at(9)
    assert np.argwhere(first).tolist() == np.argwhere(last == 2).tolist()
    centre = grown.grid.centres_of(np.argwhere(first)[0])
    assert centre == pytest.approx(small.centres_of([4, 7]))
    assert not grown.at(2).any()
    assert np.array_equal(grown.at(8), first)


@pytest.mark.parametrize("max_cells", [100, 400, 2500])
def test_a_large_map_is_joined_and_walls_stay(max_cells):
    grid = Grid(0.0, 0.0, 0.05, 100, 100)
    cells = np.ones(grid.shape, np.uint8)
    cells[:, 50] = 2
    grown = growing_map([MapMoment(1, "0", grid, MapMoment.pack(cells))], max_cells)
    assert grown is not None
    assert grown.cells[0].size <= max_cells
    assert (grown.cells[0] == 2).any(axis=1).all()


def test_moments_that_fit_no_grid_are_left_out():
    grid, other, aside = Grid(0, 0, 0.05, 9, 9), Grid(0, 0, 0.1, 9, 9), Grid(0.02, 0, 0.05, 9, 9)
    grown = growing_map([moment(1, other, (0, 0, 1)), moment(2, aside, (1, 1, 1)), moment(3, grid, (2, 2, 1))])
    assert grown is not None
    assert list(grown.seqs) == [3]
    assert growing_map([]) is None
    assert growing_map([moment(1, grid)]) is None


def test_states():
    explored, occupancy = np.array([[0, 1, 1, 0]], np.uint8), np.array([[0, 0, 1, 1]], np.uint8)
    assert states_of(explored, occupancy).tolist() == [[0, 1, 2, 2]]
