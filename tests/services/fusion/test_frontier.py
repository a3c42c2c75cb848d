"""Frontiers on hand-made maps. '#': obstacle (explored), '.': explored, ' ': unknown, 'f': frontier (explored)."""

from __future__ import annotations

import numpy as np
import pytest

from services.fusion.core import MapConfig
from services.fusion.core.frontier import frontiers

PLAIN = MapConfig(frontier_dilation_m=0.0, frontier_min_cells=1, frontier_hole_m2=0.0)
DILATED = PLAIN.model_copy(update={"frontier_dilation_m": 0.05})


def parse(text):
    rows = [list(line) for line in text.strip("\n").split("\n")]
    cells = np.array([row + [" "] * (max(map(len, rows)) - len(row)) for row in rows])
    return (cells == "#").astype(np.uint8), (cells != " ").astype(np.uint8), (cells == "f").astype(np.uint8)


@pytest.mark.parametrize(
    ("config", "text"),
    [
        (PLAIN, "######\n#....#\n#....#\n######"),
        (PLAIN, "######\n#...f \n#...f \n######"),
        (PLAIN, "######\n#...f#\n#fff  \n    "),
        (DILATED, "########\n#......   \n#.....f   \n#.....f   \n#......   \n########"),
        (PLAIN.model_copy(update={"frontier_min_cells": 3}), "######\n#....  \n#....  \n######"),
    ],
    ids=["closed room", "open to the right", "an L", "walls push it off by a cell", "specks are dropped"],
)
def test_boundary_of_free_space(config, text):
    occupied, explored, expected = parse(text)
    np.testing.assert_array_equal(frontiers(occupied, explored, config), expected)


def test_against_the_definition_cell_by_cell():
    rng = np.random.default_rng(5)
    occupied = (rng.random((40, 50)) < 0.1).astype(np.uint8)
    explored = (rng.random((40, 50)) < 0.7).astype(np.uint8)
    expected = np.zeros_like(explored)
    for r in range(40):
        for c in range(50):
            near = [(r + dr, c + dc) for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0))]
            unknown = [not (0 <= i < 40 and 0 <= j < 50 and explored[i, j]) for i, j in near]
            wall = occupied[max(0, r - 1) : r + 2, max(0, c - 1) : c + 2].any()
            expected[r, c] = explored[r, c] and not wall and any(unknown)
    np.testing.assert_array_equal(frontiers(occupied, explored, DILATED), expected)


def test_small_unknown_islands_are_no_frontier():
    occupied, explored = np.zeros((40, 40), np.uint8), np.ones((40, 40), np.uint8)
    explored[10:14, 10:14] = 0  # 0.04 m^2
    explored[20:30, 20:30] = 0  # 0.25 m^2
    found = frontiers(occupied, explored, PLAIN.model_copy(update={"frontier_hole_m2": 0.1}))
    assert not found[8:16, 8:16].any()
    assert found[19:31, 19:31].sum() == 40


def test_the_papers_words():
    occupied, explored = np.zeros((9, 9), np.uint8), np.zeros((9, 9), np.uint8)
    occupied[4, 4] = explored[4, 4] = 1
    explored[:, :4] = 1
    found = frontiers(occupied, explored, DILATED.model_copy(update={"frontier": "literal"}))
    expected = np.zeros_like(found)
    expected[3:6, 3:6] = 1
    np.testing.assert_array_equal(found, expected & (1 - explored))


def test_an_empty_map_has_none():
    assert frontiers(np.zeros((5, 5), np.uint8), np.zeros((5, 5), np.uint8), MapConfig()).sum() == 0
