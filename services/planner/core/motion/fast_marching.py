"""The Fast Marching Method (Sethian 1996; the paper's section IV-E), first order, in time O(n) for n cells.

It uses an untidy priority queue (Yatziv, Bartesaghi, Sapiro 2006: "O(N) implementation of the fast marching algorithm"): a
ring of buckets, each as wide as the time that half a cell takes at full speed. Cells of one bucket are accepted in any order.
That saves the heap, and costs far less accuracy than the first-order scheme itself (a test compares both).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

_NONE = -1
_BUCKETS_PER_CELL = 2.0


def fast_march(
    speed: NDArray[np.float64],
    sources: NDArray[np.bool_],
    stop_cell: tuple[int, int] | None = None,
    margin: float = math.inf,
) -> NDArray[np.float64]:
    """Solves |grad T| = 1 / speed: the arrival times T of a front that starts at the sources.

    Args:
        speed: (rows, cols) in [0, 1], 0 where nothing passes.
        sources: (rows, cols) bool; sources where nothing passes don't count.
        stop_cell: (row, col) of a cell. The front stops ``margin`` after it reached this cell.
        margin: a time, in cells at speed 1.

    Returns:
        (rows, cols) float64, times in cells at speed 1; inf where the front didn't arrive.
    """
    rows, cols = speed.shape
    slowness = np.zeros((rows + 2, cols + 2))  # an impassable rim saves checking for the edge
    np.divide(1.0, speed, out=slowness[1:-1, 1:-1], where=speed > 0.0)
    seeds = np.flatnonzero(np.pad(sources & (speed > 0.0), 1))
    stop = -1 if stop_cell is None else (stop_cell[0] + 1) * (cols + 2) + stop_cell[1] + 1
    time: NDArray[np.float64] = _propagate(slowness.ravel(), cols + 2, seeds, stop, margin)
    return time.reshape(rows + 2, cols + 2)[1:-1, 1:-1]


@njit(cache=True)  # type: ignore[untyped-decorator]
def _propagate(slowness, width, seeds, stop, margin):  # type: ignore[no-untyped-def]
    time = np.full(slowness.size, np.inf)
    done = np.full(slowness.size, np.inf)  # times of accepted cells only
    after = np.empty(slowness.size, dtype=np.int32)  # doubly linked lists of the cells in each bucket
    before = np.empty(slowness.size, dtype=np.int32)
    n_buckets = math.ceil(_BUCKETS_PER_CELL * slowness.max()) + 3
    first = np.full(n_buckets, _NONE, dtype=np.int32)
    for cell in seeds:
        time[cell] = 0.0
        _push(first, after, before, cell, 0)
    waiting = len(seeds)
    bucket, limit = 0, np.inf
    while waiting > 0 and bucket <= limit:
        cell = first[bucket % n_buckets]
        if cell == _NONE:
            bucket += 1
            continue
        _remove(first, after, before, cell, bucket % n_buckets)
        done[cell] = time[cell]
        waiting -= 1
        if cell == stop:
            limit = (time[cell] + margin) * _BUCKETS_PER_CELL
        for n in (cell - width, cell - 1, cell + 1, cell + width):
            slow = slowness[n]
            if slow == 0.0 or done[n] < np.inf:
                continue
            # the upwind solution from the accepted neighbours
            a, b = min(done[n - width], done[n + width]), min(done[n - 1], done[n + 1])
            difference = abs(a - b)
            if difference < slow:
                new = 0.5 * (a + b + math.sqrt(2.0 * slow * slow - difference * difference))
            else:  # also where one of them is inf
                new = min(a, b) + slow
            old = time[n]
            if new >= old:
                continue
            time[n] = new
            now = max(bucket, int(new * _BUCKETS_PER_CELL))
            if old < np.inf:
                was = max(bucket, int(old * _BUCKETS_PER_CELL))
                if now == was:
                    continue
                _remove(first, after, before, n, was % n_buckets)
            else:
                waiting += 1
            _push(first, after, before, n, now % n_buckets)
    return done


@njit(cache=True, inline="always")  # type: ignore[untyped-decorator]
def _push(first, after, before, cell, slot):  # type: ignore[no-untyped-def]
    head = first[slot]
    after[cell], before[cell] = head, _NONE
    if head != _NONE:
        before[head] = cell
    first[slot] = cell


@njit(cache=True, inline="always")  # type: ignore[untyped-decorator]
def _remove(first, after, before, cell, slot):  # type: ignore[no-untyped-def]
    prior, later = before[cell], after[cell]
    if prior == _NONE:
        first[slot] = later
    else:
        after[prior] = later
    if later != _NONE:
        before[later] = prior
