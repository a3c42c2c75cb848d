"""DBSCAN (Ester et al. 1996) on the points of one mask, to separate the object from the background that leaked in."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


def largest_cluster(points: NDArray[np.float32], eps_m: float, min_points: int) -> NDArray[np.int64]:
    """Indices (M,) of the largest cluster of points (N, 3) [m, camera]; empty if all are noise. Of equal ones, the first.

    It is made for about a thousand points of a subsampled mask. They face the camera, so a grid in the image plane is the only
    spatial index that pays off.
    """
    labels = dbscan(np.ascontiguousarray(points, np.float32), eps_m, min_points)
    if labels.size == 0 or labels.max() < 0:
        return np.empty(0, np.int64)
    return np.flatnonzero(labels == np.argmax(np.bincount(labels[labels >= 0])))


@njit(cache=True, nogil=True)
def dbscan(points, eps_m, min_points):  # type: ignore[no-untyped-def]
    """The cluster of each of the points (N, 3): (N,) int64, -1 for noise, numbered as scikit-learn numbers them."""
    n = points.shape[0]
    labels = np.full(n, -1, np.int64)
    if n == 0:
        return labels
    max_squared = np.float32(eps_m) * np.float32(eps_m)
    order, cell, cols, start = _sort_into_cells(points, eps_m)
    p = points[order]  # sorted by cell, and so is everything below
    is_core = _core_points(p, cell, cols, start, max_squared, min_points)
    # the points of cell c that belong to no cluster yet: unassigned[start[c] : end[c]]
    unassigned, end = np.arange(n), start[1:].copy()
    stack = np.empty(n, np.int64)
    rank = np.empty(n, np.int64)
    rank[order] = unassigned
    cluster = 0
    for seed in rank:
        if labels[seed] != -1 or not is_core[seed]:
            continue
        stack[0], depth = seed, 1
        while depth > 0:
            depth -= 1
            i = stack[depth]
            if not is_core[i]:  # a border point joins the cluster but doesn't extend it
                continue
            for c in _cells_around(cell[i], cols):  # the seed is among its own neighbours
                k = start[c]
                while k < end[c]:
                    j = unassigned[k]
                    if _is_near(p, i, j, max_squared):
                        labels[j] = cluster
                        stack[depth] = j
                        depth += 1
                        end[c] -= 1
                        unassigned[k] = unassigned[end[c]]
                    else:
                        k += 1
        cluster += 1
    return labels[rank]


@njit(cache=True, nogil=True)
def _sort_into_cells(points, eps_m):  # type: ignore[no-untyped-def]
    """Sorts points (N, 3), N > 0, into a grid in x and y with cells of at least ``eps_m`` and an empty border.

    Returns:
        Indices (N,) of the points in the order of their cells, the cell (N,) of each point in that order, the number of
        columns, and for each cell the position of its first point.
    """
    n = points.shape[0]
    x0, y0 = points[:, 0].min(), points[:, 1].min()
    width_m, height_m = points[:, 0].max() - x0, points[:, 1].max() - y0
    side_m = 1.001 * eps_m  # the margin covers what rounding may add to a distance
    while (width_m / side_m + 3) * (height_m / side_m + 3) > 16 * n + 1024:
        side_m *= 2
    cols, rows = int(width_m / side_m) + 3, int(height_m / side_m) + 3
    cell, start = np.empty(n, np.int64), np.zeros(rows * cols + 1, np.int64)
    for i in range(n):
        cell[i] = (int((points[i, 1] - y0) / side_m) + 1) * cols + int((points[i, 0] - x0) / side_m) + 1
        start[cell[i] + 1] += 1
    start = np.cumsum(start)
    order, at = np.empty(n, np.int64), start.copy()
    for i in range(n):
        order[at[cell[i]]] = i
        at[cell[i]] += 1
    return order, cell[order], cols, start


@njit(cache=True, nogil=True)
def _core_points(p, cell, cols, start, max_squared, min_points):  # type: ignore[no-untyped-def]
    """Which points (N, 3), sorted by cell, have ``min_points`` neighbours within eps, counting themselves: (N,) bool."""
    is_core = np.zeros(len(p), np.bool_)
    for i in range(len(p)):
        count = 0
        for c in _cells_around(cell[i], cols):
            for j in range(start[c], start[c + 1]):
                count += _is_near(p, i, j, max_squared)
            if count >= min_points:
                is_core[i] = True
                break
    return is_core


@njit(cache=True, nogil=True, inline="always")
def _cells_around(c, cols):  # type: ignore[no-untyped-def]
    """A cell, which comes first because most neighbours are in it, and the eight around it."""
    return c, c - 1, c + 1, c - cols, c + cols, c - cols - 1, c - cols + 1, c + cols - 1, c + cols + 1


@njit(cache=True, nogil=True, inline="always")
def _is_near(p, i, j, max_squared):  # type: ignore[no-untyped-def]
    dx, dy, dz = p[i, 0] - p[j, 0], p[i, 1] - p[j, 1], p[i, 2] - p[j, 2]
    return dx * dx + dy * dy + dz * dz <= max_squared
