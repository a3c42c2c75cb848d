"""Shortest ways over the free cells of a grid, at any angle.

A place is free if its cell is free: straight lines may cross any free cells, but may not slip between two blocked ones
that touch at a corner. Distances come from Theta* (Nash et al. 2007, "Theta*: Any-Angle Path Planning on Grids") grown
over the whole grid, its corners pulled tight: every cell remembers the last corner on its way (its parent), so
distances are lengths of ways that exist, never too short, exact where a goal is in sight, and ways need no smoothing.
Measured against exact visibility graphs of random mazes (tests): 0.03 % too long on average, at worst 0.7 cells;
8-neighbour Dijkstra is up to 8 % too long.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.geometry import Grid

#: A parent of -1: never reached.
UNREACHED = -1


@njit(cache=True)  # type: ignore[untyped-decorator]
def first_blocked(free: NDArray[np.bool_], row0: float, col0: float, row1: float, col1: float) -> float:
    """Where the straight line from (row0, col0) to (row1, col1) enters a blocked cell: share of its length, 0-1.

    Coordinates are continuous, in cells: cell (r, c) covers [r, r + 1) x [c, c + 1). Returns 2.0 if the line stays
    free, 0.0 if it starts in a blocked cell. Outside the grid everything is blocked. (Amanatides & Woo 1987.)
    """
    rows, cols = free.shape
    r, c = math.floor(row0), math.floor(col0)
    r_end, c_end = math.floor(row1), math.floor(col1)
    if r < 0 or r >= rows or c < 0 or c >= cols or not free[r, c]:
        return 0.0
    dr, dc = row1 - row0, col1 - col0
    step_r, step_c = (1 if dr > 0 else -1), (1 if dc > 0 else -1)
    inf = 1e18
    # Share of the line at which it next crosses a row or column boundary.
    next_r = ((r + 1 - row0) if dr > 0 else (r - row0)) / dr if dr != 0 else inf
    next_c = ((c + 1 - col0) if dc > 0 else (c - col0)) / dc if dc != 0 else inf
    delta_r = abs(1.0 / dr) if dr != 0 else inf
    delta_c = abs(1.0 / dc) if dc != 0 else inf
    for _ in range(abs(r_end - r) + abs(c_end - c) + 2):
        if (r == r_end and c == c_end) or min(next_r, next_c) > 1.0:
            return 2.0
        if abs(next_r - next_c) < 1e-9:  # through a corner: both cells beside it must be free
            t = next_r
            for rr, cc in ((r + step_r, c), (r, c + step_c)):
                if rr < 0 or rr >= rows or cc < 0 or cc >= cols or not free[rr, cc]:
                    return t
            r, c = r + step_r, c + step_c
            next_r, next_c = next_r + delta_r, next_c + delta_c
        elif next_r < next_c:
            t = next_r
            r, next_r = r + step_r, next_r + delta_r
        else:
            t = next_c
            c, next_c = c + step_c, next_c + delta_c
        if r < 0 or r >= rows or c < 0 or c >= cols or not free[r, c]:
            return t
    return 2.0


@njit(cache=True)  # type: ignore[untyped-decorator]
def spread(
    free: NDArray[np.bool_], seeds: NDArray[np.int64], seed_cost: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Theta* from all ``seeds`` at once over the whole grid.

    Args:
        free: (rows, cols) bool.
        seeds: (n,) flat indices of goal cells; blocked ones are ignored.
        seed_cost: (n,) distance that each begins with, in cells.

    Returns:
        distance (rows * cols,) float64 in cells, inf where unreachable, and parent (rows * cols,) int32: flat
        index of the cell where the straight line from here ends; seeds are their own parents.
    """
    rows, cols = free.shape
    distance = np.full(rows * cols, np.inf)
    parent = np.full(rows * cols, UNREACHED, dtype=np.int32)
    closed = np.zeros(rows * cols, dtype=np.bool_)
    heap = [(0.0, np.int64(0)) for _ in range(0)]
    for i in range(len(seeds)):
        s = seeds[i]
        if free[s // cols, s % cols] and seed_cost[i] < distance[s]:
            distance[s] = seed_cost[i]
            parent[s] = s
            heapq.heappush(heap, (seed_cost[i], s))
    while len(heap) > 0:
        d, s = heapq.heappop(heap)
        if closed[s]:
            continue
        closed[s] = True
        r, c = s // cols, s % cols
        # Plain Theta* turns a cell too early or too late: so its corner moves on while that shortens the way.
        for _ in range(4):
            best = np.int64(parent[s])
            corner_r, corner_c = best // cols, best % cols
            for qr in range(max(0, corner_r - 1), min(rows, corner_r + 2)):
                for qc in range(max(0, corner_c - 1), min(cols, corner_c + 2)):
                    q = qr * cols + qc
                    if not closed[q]:
                        continue
                    tighter = distance[q] + math.sqrt(float((r - qr) ** 2 + (c - qc) ** 2))
                    if tighter < distance[s] - 1e-9 and first_blocked(free, qr + 0.5, qc + 0.5, r + 0.5, c + 0.5) > 1.0:
                        distance[s] = tighter
                        parent[s] = q
            if parent[s] == best:
                break
        d = distance[s]
        p = np.int64(parent[s])
        pr, pc = p // cols, p % cols
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                rr, cc = r + dr, c + dc
                if (dr == 0 and dc == 0) or rr < 0 or rr >= rows or cc < 0 or cc >= cols or not free[rr, cc]:
                    continue
                n = rr * cols + cc
                if closed[n] or (dr != 0 and dc != 0 and not (free[rr, c] and free[r, cc])):
                    continue
                straight = distance[p] + math.sqrt(float((rr - pr) ** 2 + (cc - pc) ** 2))
                if straight < distance[n] and first_blocked(free, pr + 0.5, pc + 0.5, rr + 0.5, cc + 0.5) > 1.0:
                    distance[n] = straight
                    parent[n] = p
                    heapq.heappush(heap, (straight, n))
                    continue
                step = d + math.sqrt(float(dr * dr + dc * dc))
                if step < distance[n]:
                    distance[n] = step
                    parent[n] = s
                    heapq.heappush(heap, (step, n))
    return distance, parent


def occupied_cells(
    grid: Grid, vertices: NDArray[np.float32], triangles: NDArray[np.int32], z_min_m: float, z_max_m: float
) -> NDArray[np.bool_]:
    """(rows, cols) cells of a grid that some triangle touches between two heights [m, world]."""
    occupied = np.zeros(grid.shape, dtype=np.bool_)
    corner = grid.origin_x_m, grid.origin_y_m
    _mark_triangles(occupied, vertices, triangles, *corner, grid.resolution_m, z_min_m, z_max_m)
    return occupied


@njit(cache=True)  # type: ignore[untyped-decorator]
def _mark_triangles(
    occupied: NDArray[np.bool_],
    vertices: NDArray[np.float32],
    triangles: NDArray[np.int32],
    origin_x: float,
    origin_y: float,
    resolution: float,
    z_min: float,
    z_max: float,
) -> None:
    """Sets every cell of ``occupied`` (rows, cols) that some triangle touches between ``z_min`` and ``z_max`` [m].

    Each triangle is clipped to the slab (Sutherland-Hodgman), then every row of cells to the clipped polygon: thin
    poles and walls that a ray per cell would miss are found, and closed bodies need no inside.
    """
    rows, cols = occupied.shape
    a = np.empty((8, 3))
    b = np.empty((8, 3))
    for i in range(len(triangles)):
        low, high = np.inf, -np.inf
        for k in range(3):
            for axis in range(3):
                a[k, axis] = vertices[triangles[i, k], axis]
            low, high = min(low, a[k, 2]), max(high, a[k, 2])
        if low > z_max or high < z_min:
            continue
        n = _clip(a, 3, b, z_min, 1.0)
        n = _clip(b, n, a, z_max, -1.0)
        if n == 0:
            continue
        y_low, y_high = np.inf, -np.inf
        for k in range(n):
            a[k, 0] = (a[k, 0] - origin_x) / resolution
            a[k, 1] = (a[k, 1] - origin_y) / resolution
            y_low, y_high = min(y_low, a[k, 1]), max(y_high, a[k, 1])
        for r in range(max(0, math.floor(y_low)), min(rows - 1, math.floor(y_high)) + 1):
            x_low, x_high = np.inf, -np.inf
            for k in range(n):
                x0, y0 = a[k, 0], a[k, 1]
                x1, y1 = a[(k + 1) % n, 0], a[(k + 1) % n, 1]
                if max(y0, y1) < r or min(y0, y1) > r + 1:
                    continue
                if y0 == y1:
                    t0, t1 = 0.0, 1.0
                else:
                    t0, t1 = (r - y0) / (y1 - y0), (r + 1 - y0) / (y1 - y0)
                    t0, t1 = max(0.0, min(t0, t1)), min(1.0, max(t0, t1))
                xa, xb = x0 + t0 * (x1 - x0), x0 + t1 * (x1 - x0)
                x_low, x_high = min(x_low, xa, xb), max(x_high, xa, xb)
            if x_low <= x_high:
                for c in range(max(0, math.floor(x_low)), min(cols - 1, math.floor(x_high)) + 1):
                    occupied[r, c] = True


@njit(cache=True)  # type: ignore[untyped-decorator]
def _clip(polygon: NDArray[np.float64], n: int, out: NDArray[np.float64], z: float, side: float) -> int:
    """Keeps the part of a polygon of ``n`` corners with side * (corner z - z) >= 0; returns its number of corners."""
    m = 0
    for k in range(n):
        j = (k + 1) % n
        here, there = side * (polygon[k, 2] - z), side * (polygon[j, 2] - z)
        if here >= 0:
            for axis in range(3):
                out[m, axis] = polygon[k, axis]
            m += 1
        if (here > 0 > there) or (here < 0 < there):
            t = here / (here - there)
            for axis in range(3):
                out[m, axis] = polygon[k, axis] + t * (polygon[j, axis] - polygon[k, axis])
            m += 1
    return m
