"""Frontiers: where what is known to be free borders on what nobody has seen (the paper's section IV-C.2)."""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.services.fusion.core.config import MapConfig


def frontiers(occupied: NDArray[np.uint8], explored: NDArray[np.uint8], config: MapConfig) -> NDArray[np.uint8]:
    """Frontier cells (rows, cols) uint8 of an obstacle map and an exploration map, both (rows, cols) uint8 of 0 and 1.

    ``boundary``: explored cells outside the dilated obstacles, 4-connected to an unexplored cell; unexplored islands
    smaller than ``frontier_hole_m2`` count as explored. ``literal``: the paper's words, dilated obstacles minus the
    explored ones. Either way components (8-connected) of fewer than ``frontier_min_cells`` are dropped.
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
        # the border of the array is no frontier of its own: beyond it is unexplored like any other cell
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
    """Fills unexplored islands (8-connected) of at most ``max_cells``."""
    n, labels = cv2.connectedComponents(1 - explored, connectivity=8)
    small = _areas(labels, n) <= max_cells
    small[0] = True  # label 0 is the explored part itself
    known: NDArray[np.uint8] = _those_of(labels, small)
    return known


def _without_specks(mask: NDArray[np.uint8], min_cells: int) -> NDArray[np.uint8]:
    n, labels = cv2.connectedComponents(mask, connectivity=8)
    large = _areas(labels, n) >= min_cells
    large[0] = False
    kept: NDArray[np.uint8] = _those_of(labels, large)
    return kept


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _areas(labels, n):  # type: ignore[no-untyped-def]
    """(n,) cells of each label: OpenCV's own statistics cost five times the labels."""
    areas = np.zeros(n, np.int64)
    for label in labels.ravel():
        areas[label] += 1
    return areas


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _those_of(labels, chosen):  # type: ignore[no-untyped-def]
    """uint8 of the labels' shape: the cells of the labels that are chosen."""
    out = np.empty(labels.shape, np.uint8)
    for row in range(labels.shape[0]):
        for col in range(labels.shape[1]):
            out[row, col] = chosen[labels[row, col]]
    return out
