"""The map of a floor as it grew: what changed from frame to frame, in few bytes.

Cells are 0 (unknown), 1 (explored) or 2 (obstacle). A change is a list of runs, each two numbers: how many cells to skip
since the last run, and 4 x length + state. Numbers are written seven bits a byte, the low ones first; all but a number's
last byte have the high bit set (LEB128). Cells are counted row by row from the south-west. ``film.js`` reads it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.cli.report.record import MapMoment
from surveilnav.geometry import Grid

UNKNOWN, EXPLORED, OBSTACLE = 0, 1, 2
#: Finer maps are shown with several cells joined.
MAX_CELLS = 60_000
#: Maps that claim more than this are none.
_MOST_CELLS = 64_000_000


@dataclass(frozen=True, slots=True)
class GrowingMap:
    """One floor's map: ``grid`` holds all that was ever known, ``cells`` (T, rows, cols) its states, ``seqs`` (T,) the
    observations whose views the states hold."""

    grid: Grid
    cells: NDArray[np.uint8]
    seqs: Sequence[int]

    def at(self, seq: int) -> NDArray[np.uint8]:
        """The states (rows, cols) as they were known at observation ``seq``; nothing before the first."""
        known = sum(s <= seq for s in self.seqs)
        return self.cells[known - 1] if known else np.zeros(self.grid.shape, np.uint8)


def states_of(explored: NDArray[np.uint8], occupancy: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Both layers (rows, cols) as one of states."""
    return np.where(occupancy != 0, OBSTACLE, np.where(explored != 0, EXPLORED, UNKNOWN)).astype(np.uint8)


def growing_map(moments: Sequence[MapMoment], max_cells: int = MAX_CELLS) -> GrowingMap | None:
    """The moments of one floor on one grid, cut to what was known; None where nothing ever was.

    Moments on a grid that doesn't fit the newest (another resolution, half a cell aside) are left out.
    """
    ordered = sorted(moments, key=lambda m: m.seq)
    if not (fitting := [m for m in ordered if _fits(m.grid, ordered[-1].grid)]):
        return None
    newest = fitting[-1].grid
    boxes = [box for m in fitting if (box := _known_box(m, newest))]
    if not boxes:
        return None
    south, west = min(b[0] for b in boxes), min(b[1] for b in boxes)
    rows, cols = max(b[2] for b in boxes) - south, max(b[3] for b in boxes) - west
    if rows * cols > _MOST_CELLS:
        return None
    n = max(1, math.ceil(math.sqrt(rows * cols / max_cells)))
    joined = [_joined(_pasted(m, newest, (south, west, rows, cols)), n) for m in fitting]
    r = newest.resolution_m
    corner = newest.origin_x_m + west * r, newest.origin_y_m + south * r
    return GrowingMap(Grid(*corner, r * n, *joined[0].shape), np.stack(joined), [m.seq for m in fitting])


def changes(before: NDArray[np.uint8], after: NDArray[np.uint8]) -> bytes:
    """The runs of cells that are other in ``after`` (rows, cols) than in ``before``."""
    flat, old = after.ravel(), before.ravel()
    marked = np.where(flat != old, flat.astype(np.int16), -1)
    edges = np.flatnonzero(np.diff(marked)) + 1
    starts, ends = np.concatenate([[0], edges]), np.concatenate([edges, [len(marked)]])
    written, done = bytearray(), 0
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        if (state := int(marked[start])) >= 0:
            written += _number(start - done) + _number(4 * (end - start) + state)
            done = end
    return bytes(written)


def changed(before: NDArray[np.uint8], runs: bytes) -> NDArray[np.uint8]:
    """``before`` (rows, cols) after the runs: the inverse of ``changes``, as the page does it."""
    flat, at = before.ravel().copy(), 0
    numbers = _numbers(runs)
    for skip in numbers:
        length, state = divmod(next(numbers), 4)
        at += skip
        flat[at : at + length] = state
        at += length
    return flat.reshape(before.shape)


def _number(n: int) -> bytes:
    written = bytearray()
    while n > 127:
        written.append(n & 127 | 128)
        n >>= 7
    written.append(n)
    return bytes(written)


def _numbers(data: bytes) -> Iterator[int]:
    n = shift = 0
    for byte in data:
        n |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            yield n
            n = shift = 0


def _fits(grid: Grid, newest: Grid) -> bool:
    r = newest.resolution_m
    apart = (grid.origin_x_m - newest.origin_x_m) / r, (grid.origin_y_m - newest.origin_y_m) / r
    return abs(grid.resolution_m - r) < 1e-6 * r and all(abs(v - round(v)) < 0.01 and abs(v) < 1e6 for v in apart)


def _offset(grid: Grid, newest: Grid) -> tuple[int, int]:
    """(row, col) of a grid's corner on the newest grid."""
    r = newest.resolution_m
    return round((grid.origin_y_m - newest.origin_y_m) / r), round((grid.origin_x_m - newest.origin_x_m) / r)


def _known_box(moment: MapMoment, newest: Grid) -> tuple[int, int, int, int] | None:
    """South, west, north, east (past the end) of what a moment knows, in cells of the newest grid; None: nothing."""
    rows, cols = np.nonzero(moment.cells)
    if not len(rows):
        return None
    row, col = _offset(moment.grid, newest)
    return row + int(rows.min()), col + int(cols.min()), row + int(rows.max()) + 1, col + int(cols.max()) + 1


def _pasted(moment: MapMoment, newest: Grid, box: tuple[int, int, int, int]) -> NDArray[np.uint8]:
    """A moment's cells in ``box`` (south, west, rows, cols) of the newest grid."""
    south, west, rows, cols = box
    canvas = np.zeros((rows, cols), np.uint8)
    if known := _known_box(moment, newest):
        s, w, n, e = known
        row, col = _offset(moment.grid, newest)
        canvas[s - south : n - south, w - west : e - west] = moment.cells[s - row : n - row, w - col : e - col]
    return canvas


def _joined(cells: NDArray[np.uint8], n: int) -> NDArray[np.uint8]:
    """n x n cells become one, an obstacle before what is explored: a thin wall stays a wall."""
    padded = np.pad(cells, ((0, -cells.shape[0] % n), (0, -cells.shape[1] % n)))
    blocks = padded.reshape(padded.shape[0] // n, n, padded.shape[1] // n, n)
    return np.asarray(blocks.max(axis=(1, 3)), np.uint8)
