"""A floor's map drawn with characters: pure, from rows of numbers to lines. It does without numpy, which clients may lack."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter

from rich.text import Text

from surveilnav.occupancy import PRIOR_FREE, PRIOR_OBSTACLE
from surveilnav.rest import Area, Camera, Layer, Object, Robot

#: The cells of a layer: rows of numbers, row 0 the southernmost; NaN where nothing is known.
Cells = Sequence[Sequence[float]]

#: A character is about twice as high as wide.
_ASPECT = 2
#: (character, style, what it is), the later over the earlier.
_MARKS = {
    "prior_free": ("-", "green", "free by a map from before"),
    "explored": ("·", "bright_black", "explored"),
    "frontier": ("?", "yellow", "frontier"),
    "barred": ("x", "red", "keepout zone, or closed door or lift"),
    "prior_obstacle": ("+", "green", "wall by a map from before"),
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
    layers: Mapping[str, Cells],
    place: Layer,
    robots: Sequence[Robot],
    cameras: Sequence[Camera],
    objects: Sequence[Object],
    width: int,
    areas: Sequence[Area] = (),
) -> Drawing:
    """A map at most ``width`` characters wide.

    Args:
        layers: occupancy, explored and frontier, all of one shape. Where ``value`` is given, it is drawn instead of explored
            and frontier.
        place: where the cells lie in the world.
        objects: with all three coordinates of their centre.
        areas: of which those are drawn where no robot is sent.
    """
    layers = {**layers, **_prior(layers["occupancy"])}
    top, left, rows, cols = _extent(layers)
    if barring := [area for area in areas if area.kind == "keepout" or area.state == "closed"]:
        layers["barred"] = _barred(barring, place, layers["occupancy"])
    n = max(1, math.ceil(cols / width))
    cut = {
        name: _blocks([row[left : left + cols] for row in cells[top : top + rows]], n) for name, cells in layers.items()
    }
    board = _Board(math.ceil(rows / (_ASPECT * n)), math.ceil(cols / n))
    if "value" in cut:
        board.shade(cut.pop("value"))
        del cut["explored"], cut["frontier"]
    for name in ("prior_free", "explored", "frontier", "barred", "prior_obstacle", "occupancy"):
        if name in cut:
            board.mark(cut[name], *_MARKS[name][:2])
    cells = _Cells(place, top, left, n)
    for camera in cameras:
        board.put(cells.of(*camera.position_m[:2]), *_MARKS["camera"][:2])
    for thing in objects:
        board.put(cells.of(thing.center_m[0] or 0.0, thing.center_m[1] or 0.0), *_MARKS["object"][:2])
    for robot in robots:
        arrow = _ARROWS[round(robot.yaw_rad / (math.pi / 2)) % 4]
        board.put(cells.of(*robot.position_m[:2]), arrow, _MARKS["robot"][1])
    resolution_m = place.resolution_m * n
    return Drawing(
        board.lines(),
        _legend("value" in layers, "prior_free" in layers, bool(barring)),
        resolution_m,
        resolution_m * _ASPECT,
    )


def _barred(areas: Sequence[Area], place: Layer, like: Cells) -> Cells:
    """1 for each cell whose centre lies in an area, row by row between the sides that cross it; else 0."""
    cells = [[0] * len(row) for row in like]
    for area in areas:
        corners = [_cell_of(place, *corner) for corner in area.outline_m]
        sides = list(zip(corners, corners[1:] + corners[:1], strict=True))
        low, high = min(row for row, _ in corners), max(row for row, _ in corners)
        for row in range(max(0, math.ceil(low)), min(len(cells) - 1, math.floor(high)) + 1):
            crossed = [(a, b) for a, b in sides if (a[0] <= row) != (b[0] <= row)]
            at = sorted(a[1] + (row - a[0]) / (b[0] - a[0]) * (b[1] - a[1]) for a, b in crossed)
            for first, last in zip(at[::2], at[1::2], strict=True):
                inside = range(max(0, math.ceil(first)), min(len(cells[row]) - 1, math.floor(last)) + 1)
                for col in inside:
                    cells[row][col] = 1
    return cells


def _prior(occupancy: Cells) -> dict[str, Cells]:
    """The occupancy layer without what only a map from before has, and that as two layers of 0 and 1; {} if there is none."""
    if not any(value in (PRIOR_FREE, PRIOR_OBSTACLE) for row in occupancy for value in row):
        return {}
    return {
        "occupancy": [[0 if value in (PRIOR_FREE, PRIOR_OBSTACLE) else value for value in row] for row in occupancy],
        "prior_free": [[int(value == PRIOR_FREE) for value in row] for row in occupancy],
        "prior_obstacle": [[int(value == PRIOR_OBSTACLE) for value in row] for row in occupancy],
    }


def _extent(layers: Mapping[str, Cells]) -> tuple[int, int, int, int]:
    """(first row, first column, rows, columns) of what any layer knows; of the whole map if none knows anything."""
    known_rows: list[int] = []
    known_cols: list[int] = []
    for cells in layers.values():
        for number, row in enumerate(cells):
            first = next((col for col, value in enumerate(row) if value and math.isfinite(value)), None)
            if first is not None:
                last = next(c for c in reversed(range(len(row))) if row[c] and math.isfinite(row[c]))
                known_rows.append(number)
                known_cols += (first, last)
    if not known_rows:
        whole = next(iter(layers.values()))
        return 0, 0, len(whole), len(whole[0])
    top, left = min(known_rows), min(known_cols)
    return top, left, max(known_rows) - top + 1, max(known_cols) - left + 1


def _blocks(cells: Cells, n: int) -> list[list[float]]:
    """The largest value of each block of 2 n x n cells, which one character shows; NaN where nothing is known."""
    height = _ASPECT * n
    return [
        [
            _largest(value for row in cells[top : top + height] for value in row[left : left + n])
            for left in range(0, len(cells[0]), n)
        ]
        for top in range(0, len(cells), height)
    ]


def _largest(values: Iterable[float]) -> float:
    return max((value for value in values if not math.isnan(value)), default=math.nan)


@dataclass(frozen=True, slots=True)
class _Cells:
    """Which character shows a place of the world."""

    place: Layer
    top: int
    left: int
    n: int

    def of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """(row from the south, column) on the board; it may lie beyond it."""
        row, col = _cell_of(self.place, x_m, y_m)
        return (round(row) - self.top) // (_ASPECT * self.n), (round(col) - self.left) // self.n


def _cell_of(place: Layer, x_m: float, y_m: float) -> tuple[float, float]:
    """(row, column) of a place of the world; whole numbers are centres of cells."""
    (a, b, x0_m), (c, d, y0_m), _ = place.T_world_cell  # world = [[a, b], [c, d]] @ (col, row) + (x0, y0)
    x_m, y_m, determinant = x_m - x0_m, y_m - y0_m, a * d - b * c
    return (a * y_m - c * x_m) / determinant, (d * x_m - b * y_m) / determinant


class _Board:
    """Characters with styles, row 0 the southernmost."""

    def __init__(self, rows: int, cols: int) -> None:
        self._characters = [[" "] * cols for _ in range(rows)]
        self._styles = [[""] * cols for _ in range(rows)]

    def shade(self, values: Cells) -> None:
        """Darker to lighter from the lowest to the highest value."""
        known = [value for row in values for value in row if math.isfinite(value)]
        if not known:
            return
        low, high = min(known), max(known)
        for characters, row in zip(self._characters, values, strict=True):
            for col, value in enumerate(row):
                if math.isfinite(value):
                    share = (value - low) / max(high - low, 1e-9)
                    characters[col] = _SHADES[1 + min(int(share * (len(_SHADES) - 1)), len(_SHADES) - 2)]

    def mark(self, values: Cells, character: str, style: str) -> None:
        """Puts a character wherever the value is above 0."""
        for row, numbers in enumerate(values):
            for col, value in enumerate(numbers):
                if value > 0:
                    self.put((row, col), character, style)

    def put(self, cell: tuple[int, int], character: str, style: str) -> None:
        """One character; nothing where the cell lies beyond the map."""
        row, col = cell
        if 0 <= row < len(self._characters) and 0 <= col < len(self._characters[0]):
            self._characters[row][col], self._styles[row][col] = character, style

    def lines(self) -> list[Text]:
        """From north to south."""
        return [
            _line(row, styles) for row, styles in zip(reversed(self._characters), reversed(self._styles), strict=True)
        ]


def _line(characters: Sequence[str], styles: Sequence[str]) -> Text:
    """One line; neighbours of one style are one piece."""
    pieces = groupby(zip(characters, styles, strict=True), key=itemgetter(1))
    return Text.assemble(*(("".join(c for c, _ in piece), style) for style, piece in pieces))


def _legend(values: bool, prior: bool, barred: bool) -> Text:
    hidden = {*(("explored", "frontier") if values else ()), *(() if prior else ("prior_free", "prior_obstacle"))}
    hidden |= set() if barred else {"barred"}
    shown = [mark for name, mark in _MARKS.items() if name not in hidden]
    legend = Text("  ").join(Text.assemble((character, style), f" {what}") for character, style, what in shown)
    return Text.assemble(legend, f"  {_SHADES[1:]} value, low to high") if values else legend
