"""DBSCAN (Ester et al. 1996) on the points of one mask: the object itself, without the background that leaked in."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


def largest_cluster(points: NDArray[np.float32], eps_m: float, min_points: int) -> NDArray[np.int64]:
    """Indices (M,) of the largest cluster of points (N, 3) [m]; empty where all is noise. Ties: the first found.

    Made for the thousand or so points of a subsampled mask: sorting along one axis is all the index that pays.
    """
    labels = dbscan(np.ascontiguousarray(points, np.float32), eps_m, min_points)
    if labels.size == 0 or labels.max() < 0:
        return np.empty(0, np.int64)
    return np.flatnonzero(labels == np.argmax(np.bincount(labels[labels >= 0])))


@njit(cache=True, nogil=True)
def dbscan(points, eps_m, min_points):  # type: ignore[no-untyped-def]
    """Cluster of each point (N,) int64 of points (N, 3), -1 for noise; numbered as scikit-learn does."""
    n = points.shape[0]
    limit = np.float32(eps_m) * np.float32(eps_m)
    order = np.argsort(points[:, 0])
    p = points[order]  # neighbours lie within eps along x: a short stretch of the sorted points
    count = np.ones(n, np.int64)
    first = np.zeros(n, np.int64)
    last = np.full(n, n, np.int64)
    for i in range(n):
        low = 0 if i == 0 else first[i - 1]
        while p[i, 0] - p[low, 0] > eps_m:
            last[low] = i
            low += 1
        first[i] = low
        for j in range(low, i):
            if _near(p, i, j, limit):
                count[i] += 1
                count[j] += 1
    found = np.full(n, -1, np.int64)
    rank = np.empty(n, np.int64)
    rank[order] = np.arange(n)
    stack = np.empty(n, np.int64)
    cluster = 0
    for seed in rank:
        if found[seed] != -1 or count[seed] < min_points:
            continue
        found[seed] = cluster
        stack[0], depth = seed, 1
        while depth > 0:
            depth -= 1
            i = stack[depth]
            if count[i] < min_points:  # a border point joins but doesn't spread
                continue
            for j in range(first[i], last[i]):
                if found[j] == -1 and _near(p, i, j, limit):
                    found[j] = cluster
                    stack[depth] = j
                    depth += 1
        cluster += 1
    return found[rank]


@njit(cache=True, nogil=True, inline="always")
def _near(p, i, j, limit):  # type: ignore[no-untyped-def]
    dx, dy, dz = p[i, 0] - p[j, 0], p[i, 1] - p[j, 1], p[i, 2] - p[j, 2]
    return dx * dx + dy * dy + dz * dz <= limit
