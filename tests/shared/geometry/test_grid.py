"""Cells and world positions agree."""

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


def test_a_grid_of_the_papers_size():
    assert Grid.centred(0, 0, 24.0, 0.05).shape == (480, 480)


@pytest.mark.parametrize("bad", [(np.nan, 0, 0.05, 1, 1), (0, 0, 0, 1, 1), (0, 0, 0.05, 0, 1), (0, 0, 0.05, 1, 10**9)])
def test_grids_that_are_none_are_refused(bad):
    with pytest.raises(ValueError, match=r"finite|positive|rows and columns"):
        Grid(*bad)
