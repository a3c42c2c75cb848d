"""DBSCAN (Ester et al. 1996) on the points of one mask: the object itself, without the background that leaked in."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


def largest_cluster(points: NDArray[np.float32], eps_m: float, min_points: int) -> NDArray[np.int64]:
    """Indices (M,) of the largest cluster of points (N, 3) [m]; empty where all is noise. Ties: the first found.

    Made for the thousand or so points of a subsampled mask, which face the camera: a grid across the view is all the index
    that pays.
    """
    labels = dbscan(np.ascontiguousarray(points, np.float32), eps_m, min_points)
    if labels.size == 0 or labels.max() < 0:
        return np.empty(0, np.int64)
    return np.flatnonzero(labels == np.argmax(np.bincount(labels[labels >= 0])))


@njit(cache=True, nogil=True)
def dbscan(points, eps_m, min_points):  # type: ignore[no-untyped-def]
    """Cluster of each point (N,) int64 of points (N, 3), -1 for noise; numbered as scikit-learn does."""
    n = points.shape[0]
    found = np.full(n, -1, np.int64)
    if n == 0:
        return found
    limit = np.float32(eps_m) * np.float32(eps_m)
    order, cell, cols, start = _cells(points, eps_m)
    p = points[order]  # by cell, as all that follows
    core = _has_neighbours(p, cell, cols, start, limit, min_points)
    free, end = np.arange(n), start[1:].copy()  # points of cell c without a cluster: free[start[c] : end[c]]
    stack = np.empty(n, np.int64)
    rank = np.empty(n, np.int64)
    rank[order] = free
    cluster = 0
    for seed in rank:
        if found[seed] != -1 or not core[seed]:
            continue
        stack[0], depth = seed, 1
        while depth > 0:
            depth -= 1
            i = stack[depth]
            if not core[i]:  # a border point joins but doesn't spread
                continue
            for c in _around(cell[i], cols):  # the seed finds itself
                k = start[c]
                while k < end[c]:
                    j = free[k]
                    if _near(p, i, j, limit):
                        found[j] = cluster
                        stack[depth] = j
                        depth += 1
                        end[c] -= 1
                        free[k] = free[end[c]]
                    else:
                        k += 1
        cluster += 1
    return found[rank]


@njit(cache=True, nogil=True)
def _cells(points, eps_m):  # type: ignore[no-untyped-def]
    """Points (N, 3), N > 0, in an x-y grid whose cells are as wide as ``eps_m`` or wider, with an empty rim.

    Returns the points in the order of their cells (N,), the cells in that order (N,), cells in a row, and where each cell starts.
    """
    n = points.shape[0]
    x0, y0 = points[:, 0].min(), points[:, 1].min()
    width_m, height_m = points[:, 0].max() - x0, points[:, 1].max() - y0
    side_m = 1.001 * eps_m  # more than rounding may add to a distance
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
def _has_neighbours(p, cell, cols, start, limit, min_points):  # type: ignore[no-untyped-def]
    """Whether points ``p`` (N, 3), by cell, have ``min_points`` within reach, themselves among them: (N,) bool."""
    core = np.zeros(len(p), np.bool_)
    for i in range(len(p)):
        count = 0
        for c in _around(cell[i], cols):
            for j in range(start[c], start[c + 1]):
                count += _near(p, i, j, limit)
            if count >= min_points:
                core[i] = True
                break
    return core


@njit(cache=True, nogil=True, inline="always")
def _around(c, cols):  # type: ignore[no-untyped-def]
    """A cell, where most neighbours are, and the eight around it."""
    return c, c - 1, c + 1, c - cols, c + cols, c - cols - 1, c - cols + 1, c + cols - 1, c + cols + 1


@njit(cache=True, nogil=True, inline="always")
def _near(p, i, j, limit):  # type: ignore[no-untyped-def]
    dx, dy, dz = p[i, 0] - p[j, 0], p[i, 1] - p[j, 1], p[i, 2] - p[j, 2]
    return dx * dx + dy * dy + dz * dz <= limit
