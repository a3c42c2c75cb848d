"""Cells and world positions agree, also after growing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.geometry import Grid

metre = st.floats(-50, 50)


@given(metre, metre, st.integers(0, 99), st.integers(0, 99))
def test_a_centre_lies_in_its_cell(x, y, row, col):
    grid = Grid(x, y, 0.05, 100, 100)
    assert grid.cells_of(grid.centres_of((row, col))).tolist() == [row, col]


@given(metre, metre, metre, metre)
def test_growing_keeps_old_cells_in_place(x, y, px, py):
    grid = Grid.centred(x, y, 24.0, 0.05)
    larger = grid.grown_to((px, py), (px + 1, py + 1))
    assert larger.contains(larger.cells_of([(px, py), (px + 1, py + 1)])).all()
    row, col = grid.offset_in(larger)
    np.testing.assert_allclose(larger.centres_of((row + 3, col + 7)), grid.centres_of((3, 7)), atol=1e-6)
    assert larger.rows >= grid.rows
    assert larger.grown_to((px, py), (px, py)) is larger


def test_a_grid_of_the_papers_size():
    assert Grid.centred(0, 0, 24.0, 0.05).shape == (480, 480)


@pytest.mark.parametrize("bad", [(np.nan, 0, 0.05, 1, 1), (0, 0, 0, 1, 1), (0, 0, 0.05, 0, 1), (0, 0, 0.05, 1, 10**9)])
def test_grids_that_are_none_are_refused(bad):
    with pytest.raises(ValueError, match=r"finite|positive|rows and columns"):
        Grid(*bad)
