"""Fast Marching (Sethian 1996; the paper's section IV-E), first order, with an untidy priority queue: O(n) in the cells.

The queue is a ring of buckets, each as wide as half a cell takes at full speed (Yatziv, Bartesaghi, Sapiro 2006: "O(N)
implementation of the fast marching algorithm"). Cells of one bucket are accepted in any order, which costs far less
accuracy than the first-order scheme itself (a test compares both) and spares the heap.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

_NONE = -1
_PER_CELL = 2.0  # buckets


def march(
    speed: NDArray[np.float64],
    sources: NDArray[np.bool_],
    until: tuple[int, int] | None = None,
    margin: float = math.inf,
) -> NDArray[np.float64]:
    """Arrival times T of a front that starts at the sources: |grad T| = 1 / speed.

    Args:
        speed: (rows, cols) in [0, 1], 0 where nothing passes.
        sources: (rows, cols) bool; those where nothing passes don't count.
        until: (row, col) of a cell: the front stops ``margin`` (in cells at speed 1) after it came there.

    Returns:
        (rows, cols) float64, in cells at speed 1; inf where the front didn't come.
    """
    rows, cols = speed.shape
    slowness = np.zeros((rows + 2, cols + 2))  # a rim that nothing passes spares looking out for the edge
    np.divide(1.0, speed, out=slowness[1:-1, 1:-1], where=speed > 0.0)
    seeds = np.flatnonzero(np.pad(sources & (speed > 0.0), 1))
    stop = -1 if until is None else (until[0] + 1) * (cols + 2) + until[1] + 1
    time: NDArray[np.float64] = _march(slowness.ravel(), cols + 2, seeds, stop, margin)
    return time.reshape(rows + 2, cols + 2)[1:-1, 1:-1]


@njit(cache=True)  # type: ignore[untyped-decorator]
def _march(slowness, width, seeds, stop, margin):  # type: ignore[no-untyped-def]
    time = np.full(slowness.size, np.inf)
    done = np.full(slowness.size, np.inf)  # times of accepted cells only
    after = np.empty(slowness.size, dtype=np.int32)  # doubly linked lists of the cells in each bucket
    before = np.empty(slowness.size, dtype=np.int32)
    n_buckets = math.ceil(_PER_CELL * slowness.max()) + 3
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
        _take(first, after, before, cell, bucket % n_buckets)
        done[cell] = time[cell]
        waiting -= 1
        if cell == stop:
            limit = (time[cell] + margin) * _PER_CELL
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
            now = max(bucket, int(new * _PER_CELL))
            if old < np.inf:
                was = max(bucket, int(old * _PER_CELL))
                if now == was:
                    continue
                _take(first, after, before, n, was % n_buckets)
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
def _take(first, after, before, cell, slot):  # type: ignore[no-untyped-def]
    prior, later = before[cell], after[cell]
    if prior == _NONE:
        first[slot] = later
    else:
        after[prior] = later
    if later != _NONE:
        before[later] = prior
