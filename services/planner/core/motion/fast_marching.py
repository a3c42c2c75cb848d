"""The Fast Marching Method (Sethian 1996; the paper's section IV-E), first order, in time O(n) for n cells.

It uses an untidy priority queue (Yatziv, Bartesaghi, Sapiro 2006: "O(N) implementation of the fast marching algorithm"): a
ring of buckets, each as wide as the time that half a cell takes at full speed. Cells of one bucket are accepted in any order.
That saves the heap, and costs far less accuracy than the first-order scheme itself (a test compares both).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

_NONE = -1
_BUCKETS_PER_CELL = 2.0


def fast_march(
    speed: NDArray[np.float64],
    sources: NDArray[np.bool_],
    stops: Sequence[ArrayLike] = (),
    margin: float = math.inf,
) -> NDArray[np.float64]:
    """Solves |grad T| = 1 / speed: the arrival times T of a front that starts at the sources.

    Args:
        speed: (rows, cols) in [0, 1], 0 where nothing passes.
        sources: (rows, cols) bool; sources where nothing passes don't count.
        stops: places, each as the (row, col) of its cells (n, 2); at most 16. The front stops ``margin`` after it reached a cell
            of every place. Without any it goes everywhere.
        margin: a time, in cells at speed 1.

    Returns:
        (rows, cols) float64, times in cells at speed 1; inf where the front didn't arrive.
    """
    rows, cols = speed.shape
    slowness = np.zeros((rows + 2, cols + 2))  # an impassable rim saves checking for the edge
    np.divide(1.0, speed, out=slowness[1:-1, 1:-1], where=speed > 0.0)
    seeds = np.flatnonzero(np.pad(sources & (speed > 0.0), 1))
    places = np.zeros(slowness.shape, dtype=np.uint16)  # a bit for each that a cell belongs to
    for i, cells in enumerate(stops):
        row, col = np.asarray(cells).T + 1
        places[row, col] |= 1 << i
    awaited = (1 << len(stops)) - 1
    time: NDArray[np.float64] = _propagate(slowness.ravel(), cols + 2, seeds, places.ravel(), awaited, margin)
    return time.reshape(rows + 2, cols + 2)[1:-1, 1:-1]


@njit(cache=True)  # type: ignore[untyped-decorator]
def _propagate(slowness, width, seeds, places, awaited, margin):  # type: ignore[no-untyped-def]
    """Times of accepted cells, inf elsewhere. A cell whose time falls gets a new entry in an earlier bucket; the entry that it
    leaves behind is passed over later, once the cell is accepted, which is cheaper than taking it out of its list."""
    time = np.full(slowness.size, np.inf)
    done = np.full(slowness.size, np.inf)  # times of accepted cells only
    ahead, n_buckets = _BUCKETS_PER_CELL * slowness.max() + 3, 1
    while n_buckets < ahead:  # a power of two, so that a mask stands for the remainder
        n_buckets *= 2
    mask = n_buckets - 1
    first = np.full(n_buckets, _NONE, dtype=np.int32)  # of each bucket the entry added last
    most = len(seeds) + 4 * slowness.size  # each of its neighbours lowers a cell's time at most once
    cell_of, next_of = np.empty(most, dtype=np.int32), np.empty(most, dtype=np.int32)
    used = 0
    for cell in seeds:
        time[cell] = 0.0
        cell_of[used], next_of[used] = cell, first[0]
        first[0] = used
        used += 1
    waiting = len(seeds)
    bucket, limit = 0, np.inf
    while waiting > 0 and bucket <= limit:
        entry = first[bucket & mask]
        if entry == _NONE:
            bucket += 1
            continue
        first[bucket & mask] = next_of[entry]
        cell = cell_of[entry]
        if done[cell] < np.inf:
            continue
        done[cell] = time[cell]
        waiting -= 1
        if awaited and awaited & places[cell]:
            awaited &= ~places[cell]
            if awaited == 0:
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
                if now == max(bucket, int(old * _BUCKETS_PER_CELL)):
                    continue
            else:
                waiting += 1
            cell_of[used], next_of[used] = n, first[now & mask]
            first[now & mask] = used
            used += 1
    return done
