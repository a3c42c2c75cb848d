"""A room as a place for furniture: where a piece fits without blocking a door, a window or the way."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.simulator.procedural.floor_plan import Hole, free_edges
from surveilnav.simulator.procedural.layout import Rect
from surveilnav.simulator.procedural.walls import HALF_M

#: A door's swing and step: nothing stands there [m].
_DOOR_ZONE_M = 0.8
#: What is higher than this doesn't stand in front of a window [m].
_SILL_M = 0.95
#: Half of the width that a robot needs, with some room for error [m].
_WAY_M = 0.28
#: How near to a piece the way must lead [m].
_ACCESS_M = 0.55
#: So much of a room's free ground stays connected with its doors.
_REACHED = 0.85
_CELL_M = 0.1
_GAP_M = 0.02
#: The front of a piece by quarter turn: -y, +x, +y, -x.
FRONTS = ((0, -1), (1, 0), (0, 1), (-1, 0))


@dataclass(frozen=True, slots=True)
class Placed:
    """A piece at (x, y), ``z_m`` above the floor, turned by quarters counter-clockwise from looking towards -y."""

    kind: str
    x: float
    y: float
    quarter: int
    size_m: tuple[float, float, float]
    z_m: float = 0.0

    @property
    def footprint(self) -> Rect:
        w, d = self.size_m[:2] if self.quarter % 2 == 0 else (self.size_m[1], self.size_m[0])
        return Rect(self.x - w / 2, self.y - d / 2, self.x + w / 2, self.y + d / 2)

    def zone(self, reach_m: float) -> Rect:
        """The ground before it."""
        f, (fx, fy) = self.footprint, FRONTS[self.quarter]
        if fx:
            return Rect(f.x1, f.y0, f.x1 + reach_m, f.y1) if fx > 0 else Rect(f.x0 - reach_m, f.y0, f.x0, f.y1)
        return Rect(f.x0, f.y1, f.x1, f.y1 + reach_m) if fy > 0 else Rect(f.x0, f.y0 - reach_m, f.x1, f.y0)


class RoomSpace:
    """What is free in a room. ``pieces`` grows as they are placed; ``closed``: ground that has to stay free."""

    def __init__(self, rects: Sequence[Rect], holes: Sequence[Hole], closed: Sequence[Rect] = ()) -> None:
        self.rects = [r.inset(HALF_M) for r in rects]
        self.pieces: list[Placed] = []
        self._walls = [edge for r in rects for edge in free_edges(r, rects)]
        doors = [h for h in holes if "window" not in h.what]
        self.zones = [*(_zone(h, _DOOR_ZONE_M, 0.1) for h in doors), *closed]
        self.windows = [_zone(h, 0.45, 0.0) for h in holes if "window" in h.what]
        self._inside = _Raster(rects)
        # Through a closed front door nobody walks.
        self._doors = [p for h in doors if h.what != "front" for p in self._before(h)]
        self._doors += [((c.x0 + c.x1) / 2, (c.y0 + c.y1) / 2) for c in closed]

    def _before(self, hole: Hole) -> list[tuple[float, float]]:
        """The point in the room before a door."""
        steps = ((0.0, 0.45), (0.0, -0.45)) if hole.along_x else ((0.45, 0.0), (-0.45, 0.0))
        points = [(hole.x + dx, hole.y + dy) for dx, dy in steps]
        return [p for p in points if any(r.x0 <= p[0] <= r.x1 and r.y0 <= p[1] <= r.y1 for r in self.rects)]

    # -- finding places -------------------------------------------------------------------------------------------

    def at_wall(
        self,
        kind: str,
        size_m: tuple[float, float, float],
        rng: np.random.Generator,
        *,
        front_m: float = 0.5,
        corner: bool = False,
        z_m: float = 0.0,
        facing: Placed | None = None,
        tries: int = 8,
    ) -> Placed | None:
        """Places a piece with its back to a wall.

        Args:
            front_m: so much of the ground before it stays free of other pieces.
            corner: in a corner of the room, where there is one free.
            facing: opposite to this piece, where that can be had.
        """
        candidates = list(self._along_walls(kind, size_m, z_m))
        order = rng.permutation(len(candidates))
        costs = np.array([self._cost(c, corner, facing) for c in candidates])
        order = order[np.argsort(costs[order], kind="stable")] if len(candidates) else order
        tried = 0
        for index in order:
            piece = candidates[int(index)]
            if not self.fits(piece, front_m):
                continue
            if self.add(piece):
                return piece
            tried += 1
            if tried >= tries:
                break
        return None

    def _along_walls(self, kind: str, size_m: tuple[float, float, float], z_m: float) -> Iterator[Placed]:
        w, d, _ = size_m
        for along_x, at, low, high in self._walls:
            low, high = low + HALF_M + _GAP_M, high - HALF_M - _GAP_M
            if high - low < w:
                continue
            sign = 1.0 if self._is_inside(along_x, at + 0.2, (low + high) / 2) else -1.0
            quarter = (2 if sign > 0 else 0) if along_x else (1 if sign > 0 else 3)
            across = at + sign * (HALF_M + _GAP_M + d / 2)
            for s in np.linspace(low + w / 2, high - w / 2, max(2, math.ceil((high - low - w) / 0.15) + 1)):
                x, y = (float(s), across) if along_x else (across, float(s))
                yield Placed(kind, round(x, 3), round(y, 3), quarter, size_m, z_m)

    def _is_inside(self, along_x: bool, across: float, along: float) -> bool:
        x, y = (along, across) if along_x else (across, along)
        return any(r.x0 <= x <= r.x1 and r.y0 <= y <= r.y1 for r in self.rects)

    def _cost(self, piece: Placed, corner: bool, facing: Placed | None) -> float:
        """How badly a place suits the request: 0 is best."""
        if facing is not None:
            (fx, fy), (gx, gy) = FRONTS[piece.quarter], FRONTS[facing.quarter]
            aside = abs(piece.x - facing.x) if fy else abs(piece.y - facing.y)
            return (0.0 if (fx, fy) == (-gx, -gy) else 4.0) + aside
        if corner:
            f = piece.footprint
            gaps = [min(f.x0 - r.x0, r.x1 - f.x1) + min(f.y0 - r.y0, r.y1 - f.y1) for r in self.rects if r.contains(f)]
            return round(min(gaps) / 0.3) if gaps else 99.0
        return 0.0

    def in_the_open(
        self, kind: str, size_m: tuple[float, float, float], quarter: int, rng: np.random.Generator, tries: int = 8
    ) -> Placed | None:
        """Places a piece near the middle of the room."""
        spots = []
        for r in self.rects:
            for _ in range(24):
                x, y = rng.normal((r.x0 + r.x1) / 2, r.width / 6), rng.normal((r.y0 + r.y1) / 2, r.depth / 6)
                spots.append(Placed(kind, round(float(x), 2), round(float(y), 2), quarter, size_m))
        for piece in [s for s in spots if self.fits(s, 0.0)][:tries]:
            if self.add(piece):
                return piece
        return None

    # -- tests ----------------------------------------------------------------------------------------------------

    def fits(self, piece: Placed, front_m: float = 0.0) -> bool:
        """Whether it stands within the room, clear of doors, windows and other pieces."""
        f = piece.footprint
        if not any(r.contains(f, 1e-3) for r in self.rects) or any(f.overlaps(z) for z in self.zones):
            return False
        if piece.z_m + piece.size_m[2] > _SILL_M and any(f.overlaps(w) for w in self.windows):
            return False
        low, high = piece.z_m, piece.z_m + piece.size_m[2]
        near = [p for p in self.pieces if p.z_m < high - 1e-6 and low < p.z_m + p.size_m[2] - 1e-6]
        if any(f.overlaps(p.footprint, 1e-3) for p in near):
            return False
        if front_m <= 0.0:
            return True
        zone = piece.zone(front_m)
        return any(r.contains(zone, 0.01) for r in self.rects) and not any(zone.overlaps(p.footprint) for p in near)

    def add(self, piece: Placed) -> bool:
        """Places it if all doors stay connected and everything placed stays within reach."""
        self.pieces.append(piece)
        if piece.z_m > 0.3 or self._walkable():
            return True
        self.pieces.pop()
        return False

    def _walkable(self) -> bool:
        standing = [p for p in self.pieces if p.z_m <= 0.3]
        component = self._inside.component([p.footprint for p in standing], self._doors)
        if component is None:
            return False
        return all(self._inside.touches(component, p.footprint) for p in standing)


class _Raster:
    """The room in cells of 10 cm."""

    def __init__(self, rects: Sequence[Rect]) -> None:
        self.x0, self.y0 = min(r.x0 for r in rects) - 0.2, min(r.y0 for r in rects) - 0.2
        cols = math.ceil((max(r.x1 for r in rects) + 0.2 - self.x0) / _CELL_M)
        rows = math.ceil((max(r.y1 for r in rects) + 0.2 - self.y0) / _CELL_M)
        self.inside = np.zeros((rows, cols), np.uint8)
        for r in rects:
            self._fill(self.inside, r.inset(HALF_M), 1)
        for a, b in combinations(rects, 2):
            self._bridge(a, b)

    def _bridge(self, a: Rect, b: Rect) -> None:
        """Fills the seam between two rectangles of the room."""
        low_x, high_x = max(a.x0, b.x0), min(a.x1, b.x1)
        low_y, high_y = max(a.y0, b.y0), min(a.y1, b.y1)
        if high_x - low_x > 0.2 and abs(high_y - low_y) < 1e-6:
            self._fill(self.inside, Rect(low_x + HALF_M, low_y - 0.15, high_x - HALF_M, low_y + 0.15), 1)
        if high_y - low_y > 0.2 and abs(high_x - low_x) < 1e-6:
            self._fill(self.inside, Rect(low_x - 0.15, low_y + HALF_M, low_x + 0.15, high_y - HALF_M), 1)

    def _cells(self, r: Rect) -> tuple[slice, slice]:
        rows = [max(0, math.floor((y - self.y0) / _CELL_M + 0.5)) for y in (r.y0, r.y1)]
        cols = [max(0, math.floor((x - self.x0) / _CELL_M + 0.5)) for x in (r.x0, r.x1)]
        return slice(*rows), slice(*cols)

    def _fill(self, mask: NDArray[np.uint8], r: Rect, value: int) -> None:
        mask[self._cells(r)] = value

    def component(self, footprints: Sequence[Rect], doors: Sequence[tuple[float, float]]) -> NDArray[np.bool_] | None:
        """The cells that a robot can reach from all doors; None where pieces part them, or cut off much of the room."""
        free = self.inside.copy()
        for f in footprints:
            self._fill(free, f, 0)
        wide = (cv2.distanceTransform(free, cv2.DIST_L2, 5) * _CELL_M >= _WAY_M).astype(np.uint8)
        _, labels = cv2.connectedComponents(wide, connectivity=4)
        numbers = {int(labels[int((y - self.y0) / _CELL_M), int((x - self.x0) / _CELL_M)]) for x, y in doors}
        if len(numbers) != 1 or 0 in numbers:
            return None
        component = np.asarray(labels == numbers.pop())
        return component if component.sum() >= _REACHED * wide.sum() else None

    def touches(self, component: NDArray[np.bool_], footprint: Rect) -> bool:
        return bool(component[self._cells(footprint.inset(-_ACCESS_M))].any())


def _zone(hole: Hole, reach_m: float, aside_m: float) -> Rect:
    half = hole.width_m / 2 + aside_m
    if hole.along_x:
        return Rect(hole.x - half, hole.y - reach_m, hole.x + half, hole.y + reach_m)
    return Rect(hole.x - reach_m, hole.y - half, hole.x + reach_m, hole.y + half)
