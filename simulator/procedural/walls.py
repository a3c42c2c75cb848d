"""Walls around and between the rooms of a floor.

The rooms' rectangles reach to the centre lines of the inner walls. Outer walls lie outside them, with their inner face
where an inner wall's would be, so that all rooms lose the same strip.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from surveilnav.simulator.procedural.floor_plan import OUTSIDE, Space
from surveilnav.simulator.procedural.layout import Rect

INNER_M, OUTER_M = 0.12, 0.25
HALF_M = INNER_M / 2

Point = tuple[float, float]
Segment = tuple[Point, Point]


class Raster:
    """The rooms of a floor on the raster of all their edges.

    ``owner`` (columns, rows): the number of the room in each cell, with a border of ``OUTSIDE`` around.
    """

    def __init__(self, groups: Sequence[Sequence[Rect]]) -> None:
        rects = [r for group in groups for r in group]
        self.xs = sorted({round(v, 2) for r in rects for v in (r.x0, r.x1)})
        self.ys = sorted({round(v, 2) for r in rects for v in (r.y0, r.y1)})
        self.owner: NDArray[np.int64] = np.full((len(self.xs) + 1, len(self.ys) + 1), OUTSIDE)
        for number, group in enumerate(groups):
            for r in group:
                i0, i1 = (self.xs.index(round(v, 2)) for v in (r.x0, r.x1))
                j0, j1 = (self.ys.index(round(v, 2)) for v in (r.y0, r.y1))
                self.owner[i0 + 1 : i1 + 1, j0 + 1 : j1 + 1] = number

    def outline(self, number: int) -> list[Point]:
        """The corners of a room, or with ``OUTSIDE`` of the whole floor, counter-clockwise."""
        inside = self.owner != OUTSIDE if number == OUTSIDE else self.owner == number
        following: dict[tuple[int, int], tuple[int, int]] = {}
        for i, j in np.argwhere(inside):
            # Cell (i, j) lies between lines i - 1 and i, j - 1 and j; its side is the room's where the next isn't.
            for di, dj, a, b in (
                (0, -1, (i - 1, j - 1), (i, j - 1)),
                (1, 0, (i, j - 1), (i, j)),
                (0, 1, (i, j), (i - 1, j)),
                (-1, 0, (i - 1, j), (i - 1, j - 1)),
            ):
                if not inside[i + di, j + dj]:
                    following[int(a[0]), int(a[1])] = (int(b[0]), int(b[1]))
        first = at = min(following)
        corners: list[tuple[int, int]] = []
        while not corners or at != first:
            corners.append(at)
            at = following[at]
        points = [(self.xs[i], self.ys[j]) for i, j in corners]
        return [
            p
            for q, p, r in zip(points[-1:] + points, points, points[1:] + points[:1], strict=False)
            if not (q[0] == p[0] == r[0] or q[1] == p[1] == r[1])
        ]

    def inner_walls(self) -> list[Segment]:
        """Centre lines between rooms; each ends at the face of the wall that it meets."""
        return [*self._lines(along_x=True), *self._lines(along_x=False)]

    def _wall(self, i: int, j: int, *, along_x: bool) -> bool:
        """Whether an inner wall lies along x from line i to i + 1 on line j (or along y: from j to j + 1 on i)."""
        if along_x:
            if not 0 <= i < len(self.xs) - 1:
                return False
            a, b = self.owner[i + 1, j], self.owner[i + 1, j + 1]
        else:
            if not 0 <= j < len(self.ys) - 1:
                return False
            a, b = self.owner[i, j + 1], self.owner[i + 1, j + 1]
        return bool(a != b and OUTSIDE not in (a, b))

    def _lines(self, *, along_x: bool) -> Iterator[Segment]:
        """Runs of wall. Where two cross the one along x goes through; at a corner it fills the corner."""
        steps, lines = (self.xs, self.ys) if along_x else (self.ys, self.xs)
        for line, at in enumerate(lines):
            begin = None
            for step in range(len(steps)):
                i, j = (step, line) if along_x else (line, step)
                on = self._wall(i, j, along_x=along_x)
                if begin is not None and (not on or (not along_x and self._crossed(i, j))):
                    low, high = (
                        steps[begin] - self._reach(begin, line, along_x),
                        steps[step] + self._reach(step, line, along_x),
                    )
                    yield ((low, at), (high, at)) if along_x else ((at, low), (at, high))
                    begin = None
                if on and begin is None:
                    begin = step

    def _crossed(self, i: int, j: int) -> bool:
        return self._wall(i - 1, j, along_x=True) and self._wall(i, j, along_x=True)

    def _reach(self, step: int, line: int, along_x: bool) -> float:
        """How far a run goes beyond the corner where it ends: it fills a corner that it shares with one other."""
        if not along_x:
            return -HALF_M
        sides = self._wall(step, line - 1, along_x=False), self._wall(step, line, along_x=False)
        around = self.owner[step : step + 2, line : line + 2]
        return HALF_M if sum(sides) == 1 and OUTSIDE not in around else -HALF_M


def inset(corners: Sequence[Point], by: float) -> tuple[Point, ...]:
    """A counter-clockwise outline of right angles, moved inwards (outwards where negative)."""
    moved = []
    count = len(corners)
    for k in range(count):
        before, here, after = np.array(corners[k - 1]), np.array(corners[k]), np.array(corners[(k + 1) % count])
        shift = np.zeros(2)
        for d in (here - before, after - here):
            d = d / np.abs(d).sum()
            shift += by * np.array([-d[1], d[0]])
        moved.append((round(float(here[0] + shift[0]), 3), round(float(here[1] + shift[1]), 3)))
    return tuple(moved)


def raster_of(spaces: Sequence[Space]) -> Raster:
    return Raster([s.rects for s in spaces])
