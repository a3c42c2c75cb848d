"""One floor of a generated building: its rooms, and the doors and windows between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from surveilnav.simulator.procedural.layout import Rect, snap

OUTSIDE = -1
DOOR_WIDTH_M = 0.95
#: A door stays so far from the corner of a room [m].
_CORNER_M = 0.12


@dataclass(frozen=True, slots=True)
class Space:
    """A room: rectangles without walls between them. ``type`` as in ``room_statistics.json`` or ``assumptions``."""

    name: str
    type: str
    rects: tuple[Rect, ...]

    @property
    def area_m2(self) -> float:
        return sum(r.area for r in self.rects)


@dataclass(frozen=True, slots=True)
class Hole:
    """A door or window in the wall between two rooms (``OUTSIDE`` for none).

    ``quarter``: the way it looks in quarter turns from -y; doors to either side, windows and front doors inwards.
    ``what``: "door", "frame" (wide, without a leaf), "front" (closed, to the street), "window", "small window".
    """

    what: str
    rooms: tuple[int, int]
    x: float
    y: float
    width_m: float
    quarter: int

    @property
    def along_x(self) -> bool:
        return self.quarter % 2 == 0


@dataclass(slots=True)
class FloorPlan:
    """Rooms and holes of a floor. Room 0 is the corridor; ``ways``: the part of it where doors may be (no stairs)."""

    ways: tuple[Rect, ...] = ()
    spaces: list[Space] = field(default_factory=list)
    holes: list[Hole] = field(default_factory=list)

    def add(self, name: str, type_: str, *rects: Rect) -> int:
        """Adds a room; returns its number."""
        self.spaces.append(Space(name, type_, rects))
        return len(self.spaces) - 1

    def connect(
        self,
        a: int,
        b: int,
        rng: np.random.Generator,
        what: str = "door",
        width_m: float = DOOR_WIDTH_M,
        sides: tuple[Rect, ...] = (),
    ) -> bool:
        """A door somewhere in the wall between two rooms (of ``sides`` of the first, if given).

        False where there is no wall long enough that has no door yet.
        """
        first = sides or (self.ways if a == 0 else self.spaces[a].rects)
        edges = [e for p in first for q in self.spaces[b].rects if (e := shared_edge(p, q)) is not None]
        edges = [e for e in edges if e[3] - e[2] >= width_m + 2 * _CORNER_M]
        if not edges:
            return False
        for _ in range(6):
            along_x, at, low, high = edges[int(rng.integers(len(edges)))]
            # Mostly near a corner, as architects do: the rest of the wall is good for furniture.
            reach = high - low - width_m - 2 * _CORNER_M
            offset = reach * float(rng.choice([0.0, 0.0, 1.0, 1.0, rng.random()]))
            middle = low + _CORNER_M + width_m / 2 + offset
            x, y = (middle, at) if along_x else (at, middle)
            hole = Hole(what, (a, b), round(x, 3), round(y, 3), width_m, 0 if along_x else 1)
            if not any(_overlap(hole, other) for other in self.holes):
                self.holes.append(hole)
                return True
        return False

    def facade(self, space: int) -> list[tuple[bool, float, float, float]]:
        """The parts of a room's walls with nothing behind them, as (along x, where, from, to)."""
        others = [r for s in self.spaces for r in s.rects]
        return [edge for rect in self.spaces[space].rects for edge in free_edges(rect, others)]


def _overlap(a: Hole, b: Hole) -> bool:
    """Whether two doors come nearer to each other than their frames allow."""
    apart = (a.width_m + b.width_m) / 2 + 0.1
    return abs(a.x - b.x) < (apart if a.along_x else 0.1) and abs(a.y - b.y) < (0.1 if a.along_x else apart)


def shared_edge(a: Rect, b: Rect) -> tuple[bool, float, float, float] | None:
    """The common side of two rectangles as (along x, where, from, to), or None."""
    low, high = max(a.x0, b.x0), min(a.x1, b.x1)
    if high - low > 1e-6:
        for p, q in ((a.y0, b.y1), (a.y1, b.y0)):
            if abs(p - q) < 1e-6:
                return True, p, low, high
    low, high = max(a.y0, b.y0), min(a.y1, b.y1)
    if high - low > 1e-6:
        for p, q in ((a.x0, b.x1), (a.x1, b.x0)):
            if abs(p - q) < 1e-6:
                return False, p, low, high
    return None


def free_edges(rect: Rect, others: Sequence[Rect]) -> list[tuple[bool, float, float, float]]:
    """The parts of a rectangle's sides that it shares with none of the others: (along x, where, from, to)."""
    found = []
    for along_x, at in ((True, rect.y0), (True, rect.y1), (False, rect.x0), (False, rect.x1)):
        free = [(rect.x0, rect.x1) if along_x else (rect.y0, rect.y1)]
        for other in others:
            edge = shared_edge(rect, other)
            if other is rect or edge is None or edge[0] != along_x or abs(edge[1] - at) > 1e-6:
                continue
            free = [
                (a, b)
                for low, high in free
                for a, b in ((low, min(high, edge[2])), (max(low, edge[3]), high))
                if b - a > 1e-6
            ]
        found += [(along_x, at, low, high) for low, high in free]
    return found


#: Rooms whose windows are small and high, and rooms without.
_SMALL_WINDOWS, _NO_WINDOWS = ("bath", "toilet", "washroom"), ("storage", "laundry")


def add_windows(floor: FloorPlan, rng: np.random.Generator, *, ground: bool) -> None:
    """Windows in every facade, and the closed front door at one end of the ground floor's corridor."""
    front = not ground
    for number, space in enumerate(floor.spaces):
        if space.type in _NO_WINDOWS:
            continue
        for along_x, at, low, high in floor.facade(number):
            length = high - low
            if space.type == "corridor" and not front and 1.5 <= length <= 2.5:
                _pierce(floor, "front", number, along_x, at, (low + high) / 2, 1.0)
                front = True
                continue
            if space.type in _SMALL_WINDOWS:
                if length >= 1.0:
                    _pierce(floor, "small window", number, along_x, at, (low + high) / 2, 0.6)
                continue
            width = snap(rng.uniform(1.2, 1.5)) if length >= 2.2 else 0.9
            count = int(length / 2.6) if length >= 2.6 else int(length >= 1.4)
            for i in range(count):
                _pierce(floor, "window", number, along_x, at, low + (i + 0.5) * length / count, width)


def _pierce(floor: FloorPlan, what: str, space: int, along_x: bool, at: float, middle: float, width: float) -> None:
    x, y = (middle, at) if along_x else (at, middle)
    before = (x, y - 0.1) if along_x else (x - 0.1, y)
    inside_first = any(r.x0 < before[0] < r.x1 and r.y0 < before[1] < r.y1 for r in floor.spaces[space].rects)
    quarter = (0 if inside_first else 2) if along_x else (3 if inside_first else 1)
    floor.holes.append(Hole(what, (space, OUTSIDE), round(x, 3), round(y, 3), width, quarter))
