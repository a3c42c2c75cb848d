"""A planar laser scan in the obstacle map: what stands at the scanner's height, apart from what depth shows. Compiled."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.sensing.views import LaserScan


def scan_window(scan: LaserScan, max_range_m: float, resolution_m: float) -> tuple[int, int, int, int]:
    """The window (row0, col0, rows, cols) of cells, counted from the world's origin, that its beams can reach."""
    x, y, _ = scan.origin_m
    low_row, low_col = (math.floor((v - max_range_m) / resolution_m) - 1 for v in (y, x))
    n = math.ceil(2 * max_range_m / resolution_m) + 3
    return low_row, low_col, n, n


@njit(cache=True, nogil=True)
def count_beams(ranges_m, ends, x, y, start_rad, step_rad, max_range_m, resolution_m, row0, col0, hits, passes):  # type: ignore[no-untyped-def]
    """Adds a scan to the counts ``hits`` and ``passes`` (rows, cols) int32 of scans that end in a cell and that pass through it.

    A scan counts once in a cell, and not as passing where it also ends. ``ends``: whether a beam ended at something.
    """
    rows, cols = hits.shape
    mark = np.zeros((rows, cols), np.uint8)
    for i in range(len(ranges_m)):
        r = min(ranges_m[i], max_range_m)
        if r <= 0.0:
            continue
        c, s = math.cos(start_rad + i * step_rad), math.sin(start_rad + i * step_rad)
        for k in range(int(r / (0.5 * resolution_m))):
            d = (k + 0.5) * 0.5 * resolution_m
            row = math.floor((y + d * s) / resolution_m) - row0
            col = math.floor((x + d * c) / resolution_m) - col0
            if d < r and 0 <= row < rows and 0 <= col < cols and mark[row, col] == 0:
                mark[row, col] = 1
        if ends[i] and ranges_m[i] <= max_range_m:
            row = math.floor((y + r * s) / resolution_m) - row0
            col = math.floor((x + r * c) / resolution_m) - col0
            if 0 <= row < rows and 0 <= col < cols:
                mark[row, col] = 2
    for row in range(rows):
        for col in range(cols):
            if mark[row, col] == 2:
                hits[row, col] += 1
            elif mark[row, col] == 1:
                passes[row, col] += 1


def obstacles_of(
    hits: NDArray[np.int32], passes: NDArray[np.int32], min_hits: int, clear_ratio: float
) -> NDArray[np.bool_]:
    """Where scans show an obstacle, (rows, cols): enough ended there, and not many more passed through."""
    return np.asarray((hits >= min_hits) & (passes <= clear_ratio * hits))
