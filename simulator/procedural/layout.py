"""The body of a generated building: corridors, the strips of rooms along them, and the place of the stairs.

Lengths in metres, on a raster of 5 cm; rectangles reach to the centre lines of the walls.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

#: Where the corridor lies, seen from a strip.
Side = Literal["south", "north", "west", "east"]

STAIR_WIDTH_M, STAIR_RUN_M = 0.9, 2.4
#: Two flights side by side (they alternate from floor to floor) and a way past them.
STAIR_HALL_WIDTH_M, STAIR_HALL_DEPTH_M = 3.3, 4.6


def snap(value: float) -> float:
    """On the raster of 5 cm."""
    return round(round(value / 0.05) * 0.05, 2)


@dataclass(frozen=True, slots=True)
class Rect:
    """x0 < x1, y0 < y1 [m]."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def width(self) -> float:
        return self.x1 - self.x0

    @property
    def depth(self) -> float:
        return self.y1 - self.y0

    @property
    def area(self) -> float:
        return self.width * self.depth

    def inset(self, by: float) -> Rect:
        return Rect(self.x0 + by, self.y0 + by, self.x1 - by, self.y1 - by)

    def overlaps(self, other: Rect, slack: float = 1e-6) -> bool:
        """Whether they share more than ``slack`` in both directions."""
        return (
            min(self.x1, other.x1) - max(self.x0, other.x0) > slack
            and min(self.y1, other.y1) - max(self.y0, other.y0) > slack
        )

    def contains(self, other: Rect, slack: float = 1e-6) -> bool:
        return (
            other.x0 >= self.x0 - slack
            and other.y0 >= self.y0 - slack
            and other.x1 <= self.x1 + slack
            and other.y1 <= self.y1 + slack
        )


@dataclass(frozen=True, slots=True)
class Strip:
    """Room for rooms along a corridor; local coordinates: ``s`` along the corridor, ``t`` away from it."""

    rect: Rect
    corridor: Side

    @property
    def length(self) -> float:
        return self.rect.width if self.corridor in ("south", "north") else self.rect.depth

    @property
    def depth(self) -> float:
        return self.rect.depth if self.corridor in ("south", "north") else self.rect.width

    def cell(self, s0: float, s1: float, t0: float = 0.0, t1: float | None = None) -> Rect:
        """A part of the strip in the world; ``t1`` None reaches to the facade."""
        r, t1 = self.rect, self.depth if t1 is None else t1
        box = {
            "south": (r.x0 + s0, r.y0 + t0, r.x0 + s1, r.y0 + t1),
            "north": (r.x0 + s0, r.y1 - t1, r.x0 + s1, r.y1 - t0),
            "west": (r.x0 + t0, r.y0 + s0, r.x0 + t1, r.y0 + s1),
            "east": (r.x1 - t1, r.y0 + s0, r.x1 - t0, r.y0 + s1),
        }[self.corridor]
        return Rect(*(round(v, 2) for v in box))

    def part(self, s0: float, s1: float) -> Strip:
        """The strip from ``s0`` to ``s1``."""
        return Strip(self.cell(s0, s1), self.corridor)


@dataclass(frozen=True, slots=True)
class Body:
    """What all floors share. ``stair_hall`` opens onto the corridor; None where there is one floor.

    ``common``: what is left behind a stair hall that doesn't take its strip's whole depth.
    """

    corridors: tuple[Rect, ...]
    strips: tuple[Strip, ...]
    stair_hall: Strip | None
    common: tuple[Rect, ...]


def office_body(area_m2: float, with_stairs: bool, rng: np.random.Generator) -> Body:
    """A bar with rooms on both sides of a corridor, or two such wings as an L or T."""
    depths = [snap(rng.uniform(4.2, 5.4)) for _ in range(2)]
    corridor = snap(rng.uniform(1.8, 2.3))
    width = sum(depths) + corridor
    wing = [snap(rng.uniform(4.0, 4.8)) for _ in range(2)]
    wing_corridor = snap(rng.uniform(1.7, 2.0))
    wing_width = sum(wing) + wing_corridor
    length = snap(wing_width + rng.uniform(6.0, 10.0))
    wing_length = snap((area_m2 - length * width) / wing_width)
    bent = wing_length >= 6.0 and rng.random() < 0.7
    if not bent:
        length, wing_length = snap(area_m2 / width), 0.0
    spine = Rect(0.0, depths[0], length, round(depths[0] + corridor, 2))
    south = Strip(Rect(0.0, 0.0, length, depths[0]), "north")
    north = Strip(Rect(0.0, spine.y1, length, round(width, 2)), "south")
    corridors, whole = [spine], [north]
    if bent:
        x = float(rng.choice([0.0, snap(length - wing_width), snap((length - wing_width) / 2)]))
        way = Rect(
            round(x + wing[0], 2), spine.y1, round(x + wing[0] + wing_corridor, 2), round(width + wing_length, 2)
        )
        corridors.append(way)
        west, east = Rect(x, width, way.x0, way.y1), Rect(way.x1, width, round(x + wing_width, 2), way.y1)
        whole = [north.part(0.0, way.x0), north.part(way.x1, length), Strip(west, "east"), Strip(east, "west")]
    stairs, south_strips, common = _with_stair_hall(south, with_stairs, rng)
    return Body(tuple(corridors), (*south_strips, *whole), stairs, common)


def flats_body(area_m2: float, with_stairs: bool, rng: np.random.Generator) -> Body:
    """A bar with flats on both sides of a corridor, or on one."""
    depths = [snap(rng.uniform(7.2, 8.4)) for _ in range(2)]
    corridor = snap(rng.uniform(1.6, 1.9))
    one_sided = area_m2 < 210.0
    width = corridor + (depths[0] if one_sided else sum(depths))
    # A stair hall and one flat have to fit side by side.
    length = max(snap(area_m2 / width), 9.5)
    spine = Rect(0.0, depths[0], length, round(depths[0] + corridor, 2))
    south = Strip(Rect(0.0, 0.0, length, depths[0]), "north")
    stairs, strips, common = _with_stair_hall(south, with_stairs, rng)
    if not one_sided:
        strips = (*strips, Strip(Rect(0.0, spine.y1, length, round(width, 2)), "south"))
    return Body((spine,), strips, stairs, common)


def _with_stair_hall(
    strip: Strip, wanted: bool, rng: np.random.Generator
) -> tuple[Strip | None, tuple[Strip, ...], tuple[Rect, ...]]:
    """The stair hall in a strip, what is left beside it, and what is left behind it."""
    if not wanted:
        return None, (strip,), ()
    free = strip.length - STAIR_HALL_WIDTH_M
    # At an end, or in the middle where something of use remains on both sides.
    choices = [0.0, free] + ([snap(free * rng.uniform(0.4, 0.6))] if free > 15.0 else [])
    at = round(float(rng.choice(choices)), 2)
    end = round(at + STAIR_HALL_WIDTH_M, 2)
    depth = min(strip.depth, STAIR_HALL_DEPTH_M)
    if strip.depth - depth < 1.5:
        depth = strip.depth
    hall = Strip(strip.cell(at, end, 0.0, depth), strip.corridor)
    behind = (strip.cell(at, end, depth),) if strip.depth > depth else ()
    left = tuple(strip.part(a, b) for a, b in ((0.0, at), (end, strip.length)) if b - a > 0.01)
    return hall, left, behind
