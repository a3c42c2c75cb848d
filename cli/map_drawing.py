"""A floor's map drawn with characters: pure, from arrays to lines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray
from rich.text import Text

from surveilnav.rest import Camera, Layer, Object, Robot

#: A character is about twice as high as wide.
_ASPECT = 2
#: (character, style, what it is), the later over the earlier.
_MARKS = {
    "explored": ("·", "bright_black", "explored"),
    "frontier": ("?", "yellow", "frontier"),
    "occupancy": ("#", "", "obstacle"),
    "camera": ("C", "bold magenta", "camera"),
    "object": ("o", "bold green", "confirmed object"),
    "robot": ("R", "bold cyan", "robot"),
}
_SHADES = " ░▒▓█"
_ARROWS = ">^<v"


@dataclass(frozen=True, slots=True)
class Drawing:
    """Lines from north to south, what the marks mean, and how much a character shows [m]."""

    lines: list[Text]
    legend: Text
    column_m: float
    line_m: float


def draw(
    layers: Mapping[str, NDArray],
    place: Layer,
    robots: Sequence[Robot],
    cameras: Sequence[Camera],
    objects: Sequence[Object],
    width: int,
) -> Drawing:
    """A map at most ``width`` characters wide.

    Args:
        layers: (rows, cols) each, row 0 the southernmost: occupancy, explored, frontier; ``value`` is drawn instead of the
            latter two where it is there.
        place: where the cells lie in the world.
        objects: with all three coordinates of their centre.
    """
    top, left, shape = _extent(layers)
    n = max(1, math.ceil(shape[1] / width))
    cut = {name: _blocks(cells[top : top + shape[0], left : left + shape[1]], n) for name, cells in layers.items()}
    rows, cols = next(iter(cut.values())).shape
    board = _Board(rows, cols)
    if "value" in cut:
        board.shade(cut.pop("value"))
        del cut["explored"], cut["frontier"]
    for name in ("explored", "frontier", "occupancy"):
        if name in cut:
            board.mark(cut[name] > 0, *_MARKS[name][:2])
    cells = _Cells(place, top, left, n)
    for camera in cameras:
        board.put(cells.of(*camera.position_m[:2]), *_MARKS["camera"][:2])
    for thing in objects:
        board.put(cells.of(thing.center_m[0] or 0.0, thing.center_m[1] or 0.0), *_MARKS["object"][:2])
    for robot in robots:
        arrow = _ARROWS[round(robot.yaw_rad / (math.pi / 2)) % 4]
        board.put(cells.of(*robot.position_m[:2]), arrow, _MARKS["robot"][1])
    resolution_m = place.resolution_m * n
    return Drawing(board.lines(), _legend("value" in layers), resolution_m, resolution_m * _ASPECT)


def _extent(layers: Mapping[str, NDArray]) -> tuple[int, int, tuple[int, int]]:
    """(first row, first column, (rows, cols)) of what any layer knows; all of it if none knows anything."""
    known: NDArray[np.bool_] = np.zeros(next(iter(layers.values())).shape, np.bool_)
    for cells in layers.values():
        known |= np.isfinite(cells) & (cells != 0) if cells.dtype.kind == "f" else cells != 0
    if not known.any():
        return 0, 0, (known.shape[0], known.shape[1])
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    return int(rows[0]), int(cols[0]), (int(rows[-1] - rows[0]) + 1, int(cols[-1] - cols[0]) + 1)


def _blocks(cells: NDArray, n: int) -> NDArray[np.float64]:
    """The largest of each block of 2 n x n cells; NaN where nothing is known."""
    height = _ASPECT * n
    padded = np.pad(
        cells.astype(np.float64), ((0, -cells.shape[0] % height), (0, -cells.shape[1] % n)), constant_values=np.nan
    )
    rows, cols = padded.shape[0] // height, padded.shape[1] // n
    largest: NDArray[np.float64] = np.fmax.reduce(np.fmax.reduce(padded.reshape(rows, height, cols, n), axis=3), axis=1)
    return largest


@dataclass(frozen=True, slots=True)
class _Cells:
    """Which character shows a place of the world."""

    place: Layer
    top: int
    left: int
    n: int

    def of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """(row from the south, column) on the board; it may lie beyond it."""
        T_world_cell = np.asarray(self.place.T_world_cell)
        col, row, _ = np.linalg.solve(T_world_cell, np.array([x_m, y_m, 1.0]))
        return (round(row) - self.top) // (_ASPECT * self.n), (round(col) - self.left) // self.n


class _Board:
    """Characters with styles, row 0 the southernmost."""

    def __init__(self, rows: int, cols: int) -> None:
        self._characters = np.full((rows, cols), " ", dtype="<U1")
        self._styles = np.full((rows, cols), "", dtype=object)

    def shade(self, values: NDArray[np.float64]) -> None:
        """Darker to lighter from the lowest to the highest value."""
        known = np.isfinite(values)
        if not known.any():
            return
        low, high = float(values[known].min()), float(values[known].max())
        share = (np.where(known, values, low) - low) / max(high - low, 1e-9)
        steps = 1 + np.minimum((share * (len(_SHADES) - 1)).astype(int), len(_SHADES) - 2)
        self._characters[known] = np.array(list(_SHADES))[steps[known]]

    def mark(self, where: NDArray[np.bool_], character: str, style: str) -> None:
        """Puts a character wherever ``where`` is true."""
        self._characters[where] = character
        self._styles[where] = style

    def put(self, cell: tuple[int, int], character: str, style: str) -> None:
        """One character; nothing where the cell lies beyond the map."""
        row, col = cell
        if 0 <= row < self._characters.shape[0] and 0 <= col < self._characters.shape[1]:
            self._characters[row, col], self._styles[row, col] = character, style

    def lines(self) -> list[Text]:
        """From north to south."""
        return [_line(row, styles) for row, styles in zip(self._characters[::-1], self._styles[::-1], strict=True)]


def _line(characters: NDArray, styles: NDArray) -> Text:
    """One line; neighbours of one style are one piece."""
    pieces = groupby(zip(map(str, characters), map(str, styles), strict=True), key=itemgetter(1))
    return Text.assemble(*(("".join(c for c, _ in piece), style) for style, piece in pieces))


def _legend(values: bool) -> Text:
    shown = [mark for name, mark in _MARKS.items() if not (values and name in ("explored", "frontier"))]
    legend = Text("  ").join(Text.assemble((character, style), f" {what}") for character, style, what in shown)
    return Text.assemble(legend, f"  {_SHADES[1:]} value, low to high") if values else legend
