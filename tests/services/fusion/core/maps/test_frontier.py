"""Frontiers on hand-made maps. '#': obstacle (explored), '.': explored, ' ': unknown, 'f': frontier (explored)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.services.fusion.core import MapConfig
from surveilnav.services.fusion.core.maps.frontier import frontiers

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


def slow(occupied, explored, kind, radius, min_cells, hole_cells):
    """The definition, cell by cell. ``radius``: dilation in cells."""
    rows, cols = occupied.shape
    inside = {(r, c) for r in range(rows) for c in range(cols)}
    walls = {
        (r, c)
        for r, c in inside
        if any(
            occupied[r + dr, c + dc]
            for dr in range(-radius, radius + 1)
            for dc in range(-radius, radius + 1)
            if dr * dr + dc * dc <= (radius + 0.5) ** 2 and (r + dr, c + dc) in inside
        )
    }
    known = {cell for cell in inside if explored[cell]}
    if kind == "literal":
        found = walls - known
    else:
        for island in parts(inside - known):
            if len(island) <= hole_cells:
                known |= island
        found = {
            (r, c)
            for r, c in inside - walls
            if explored[r, c] and not {(r + 1, c), (r - 1, c), (r, c + 1), (r, c - 1)} <= known
        }
    out = np.zeros_like(explored)
    for part in parts(found):
        if len(part) >= min_cells:
            for cell in part:
                out[cell] = 1
    return out


def parts(cells):
    """8-connected components of a set of cells."""
    left, out = set(cells), []
    while left:
        part, edge = set(), [left.pop()]
        while edge:
            r, c = edge.pop()
            part.add((r, c))
            near = {(r + dr, c + dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1)} & left
            left -= near
            edge.extend(near)
        out.append(part)
    return out


@settings(max_examples=60, deadline=None)
@given(
    kind=st.sampled_from(["boundary", "literal"]),
    radius=st.integers(0, 3),
    min_cells=st.integers(1, 9),
    hole_cells=st.integers(0, 30),
    seen=st.floats(0.3, 0.95),
    walls=st.floats(0, 0.2),
    seed=st.integers(0, 10_000),
)
def test_against_the_definition_cell_by_cell(kind, radius, min_cells, hole_cells, seen, walls, seed):
    rng = np.random.default_rng(seed)
    occupied = (rng.random((22, 27)) < walls).astype(np.uint8)
    explored = (rng.random((22, 27)) < seen).astype(np.uint8)
    config = MapConfig(
        frontier=kind,
        frontier_dilation_m=radius * 0.05,
        frontier_min_cells=min_cells,
        frontier_hole_m2=hole_cells * 0.05**2 + 1e-9,
    )
    expected = slow(occupied, explored, kind, radius, min_cells, hole_cells)
    np.testing.assert_array_equal(frontiers(occupied, explored, config), expected)


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
