"""Frontiers: where explored free space borders on unexplored space (the paper's section IV-C.2)."""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.services.fusion.core.config import MapConfig


def frontiers(occupied: NDArray[np.uint8], explored: NDArray[np.uint8], config: MapConfig) -> NDArray[np.uint8]:
    """Frontier map (rows, cols) uint8 of an obstacle map and an exploration map, all of 0 and 1.

    ``boundary``: explored cells outside of the dilated obstacles that are 4-connected to an unexplored cell; unexplored islands
    smaller than ``frontier_hole_m2`` count as explored. ``literal``: the paper's words, dilated obstacles minus explored
    cells. In both cases, 8-connected components of fewer than ``frontier_min_cells`` cells are removed.
    """
    out = np.zeros_like(explored)
    box = cv2.boundingRect(explored | occupied)  # (x, y, width, height); maps are mostly empty
    if box[2] == 0:
        return out
    margin = 2 + round(config.frontier_dilation_m / config.resolution_m)
    rows = slice(max(0, box[1] - margin), box[1] + box[3] + margin)
    cols = slice(max(0, box[0] - margin), box[0] + box[2] + margin)
    occupied, explored = occupied[rows, cols], explored[rows, cols]
    walls = _dilated(occupied, config.frontier_dilation_m / config.resolution_m)
    if config.frontier == "literal":
        found = walls & (1 - explored)
    else:
        known = _without_holes(explored, config.frontier_hole_m2 / config.resolution_m**2)
        # what lies beyond the array counts as unexplored, like any other cell that nobody has seen
        unknown = np.pad(1 - known, 1, constant_values=1)
        beside = unknown[:-2, 1:-1] | unknown[2:, 1:-1] | unknown[1:-1, :-2] | unknown[1:-1, 2:]
        found = explored & (1 - walls) & beside
    out[rows, cols] = _without_specks(found.astype(np.uint8), config.frontier_min_cells)
    return out


def _dilated(mask: NDArray[np.uint8], radius_cells: float) -> NDArray[np.uint8]:
    n = round(radius_cells)
    if n < 1:
        return mask
    dy, dx = np.mgrid[-n : n + 1, -n : n + 1]
    disk = (dx * dx + dy * dy <= (n + 0.5) ** 2).astype(np.uint8)
    return np.asarray(cv2.dilate(mask, disk), np.uint8)


def _without_holes(explored: NDArray[np.uint8], max_cells: float) -> NDArray[np.uint8]:
    """The exploration map with unexplored islands (8-connected) of at most ``max_cells`` filled."""
    n, labels = cv2.connectedComponents(1 - explored, connectivity=8)
    small = _areas(labels, n) <= max_cells
    small[0] = True  # label 0 is the explored part itself
    known: NDArray[np.uint8] = _select_labels(labels, small)
    return known


def _without_specks(mask: NDArray[np.uint8], min_cells: int) -> NDArray[np.uint8]:
    """The mask without components (8-connected) of fewer than ``min_cells``."""
    n, labels = cv2.connectedComponents(mask, connectivity=8)
    large = _areas(labels, n) >= min_cells
    large[0] = False
    kept: NDArray[np.uint8] = _select_labels(labels, large)
    return kept


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _areas(labels, n):  # type: ignore[no-untyped-def]
    """The number of cells (n,) of each label. OpenCV's own statistics take five times as long as its labels."""
    areas = np.zeros(n, np.int64)
    for label in labels.ravel():
        areas[label] += 1
    return areas


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _select_labels(labels, chosen):  # type: ignore[no-untyped-def]
    """The cells whose label is chosen: uint8 of the shape of ``labels``."""
    out = np.empty(labels.shape, np.uint8)
    for row in range(labels.shape[0]):
        for col in range(labels.shape[1]):
            out[row, col] = chosen[labels[row, col]]
    return out
