"""A building of a name like "office_3": its plan as Sweet Home 3D would have it, for ``homes.build_home``."""

from __future__ import annotations

import math
import re
from functools import lru_cache

import numpy as np

from surveilnav.simulator.plans.placing import seeded
from surveilnav.simulator.plans.sweethome import Home, Level, Piece, PlanRoom, PlanWall
from surveilnav.simulator.procedural.floor_plan import OUTSIDE, FloorPlan, Hole, add_windows
from surveilnav.simulator.procedural.furnish import furnish
from surveilnav.simulator.procedural.layout import (
    STAIR_RUN_M,
    STAIR_WIDTH_M,
    Body,
    Rect,
    flats_body,
    office_body,
)
from surveilnav.simulator.procedural.pieces import PIECES
from surveilnav.simulator.procedural.rooms import flats_floor, office_floor
from surveilnav.simulator.procedural.space import FRONTS, Placed, RoomSpace
from surveilnav.simulator.procedural.statistics import Wanted, draw
from surveilnav.simulator.procedural.walls import HALF_M, INNER_M, OUTER_M, Raster, inset, raster_of

#: What can be asked for: name -> (least and largest area of a floor without outer walls [m2], what it is).
KINDS: dict[str, tuple[tuple[float, float], str]] = {
    "office": ((195.0, 430.0), "offices along corridors, 1-4 floors of 200-450 m²"),
    "flats": ((145.0, 330.0), "apartment house, 1-4 floors of 150-350 m²"),
}
_NAME = re.compile(r"(office|flats)_(0|[1-9]\d{0,17})")
_ROOM_HEIGHT_M, _SLAB_M = 2.5, 0.12
#: Of all floors together: furniture for more has too many triangles for one scene.
_MAX_AREA_M2 = 1600.0
_FLOOR_M = _ROOM_HEIGHT_M + _SLAB_M
_RAIL_M = 0.9

#: Catalogue entry, depth, foot and height of what goes into a wall.
_HOLES = {
    "door": ("eTeks#door", "Door", 0.145, 0.0, 2.085),
    "frame": ("eTeks#doorFrame", "Door frame", 0.14, 0.0, 2.1),
    "front": ("eTeks#frontDoor", "Front door", 0.27, 0.0, 2.085),
    "window": ("eTeks#doubleWindow126x123", "Window", 0.35, 0.9, 1.35),
    "small window": ("eTeks#fixedWindow85x123", "Small window", 0.27, 1.35, 0.75),
}


def is_generated(name: str) -> bool:
    """Whether a name is one of ours: "office_<n>" or "flats_<n>"."""
    return _NAME.fullmatch(name) is not None


@lru_cache(maxsize=4)
def generated_home(name: str) -> Home:
    """The plan of "office_<n>" or "flats_<n>": the number draws size, floors, rooms and what stands in them.

    Raises:
        ValueError: another name.
    """
    match = _NAME.fullmatch(name)
    if match is None:
        raise ValueError(f"expected office_<n> or flats_<n> with a number from 0, got {name!r}")
    kind = match.group(1)
    rng = seeded(f"plan|{name}")
    body, floors = plan(kind, rng)
    levels = tuple(
        Level(f"level{i}", "Ground floor" if i == 0 else f"Floor {i}", round(i * _FLOOR_M, 2), _ROOM_HEIGHT_M, _SLAB_M)
        for i in range(len(floors))
    )
    walls: list[PlanWall] = []
    rooms: list[PlanRoom] = []
    pieces: list[Piece] = []
    for i, floor in enumerate(floors):
        raster, level = raster_of(floor.spaces), f"level{i}"
        walls += _walls(raster, level)
        rooms += [PlanRoom(s.name, level, inset(raster.outline(k), HALF_M)) for k, s in enumerate(floor.spaces)]
        pieces += [_hole_piece(hole, level) for hole in floor.holes]
        if body.stair_hall is not None:
            walls += _rails(body, i, len(floors), level)
            if i + 1 < len(floors):
                pieces.append(_stair_piece(body, i, level))
        for space in furnished(body, floor, rng):
            pieces += [_piece(p, level) for p in space.pieces]
    return Home(name, _ROOM_HEIGHT_M, levels, tuple(walls), tuple(rooms), tuple(pieces))


def plan(kind: str, rng: np.random.Generator) -> tuple[Body, list[FloorPlan]]:
    """Body and floors."""
    low, high = KINDS[kind][0]
    count = int(rng.choice([1, 2, 3, 4], p=[0.3, 0.3, 0.25, 0.15]))
    area = min(float(rng.uniform(low, high)), _MAX_AREA_M2 / count)
    body = (office_body if kind == "office" else flats_body)(area, count > 1, rng)
    floors = []
    for i in range(count):
        floor = (office_floor if kind == "office" else flats_floor)(body, i, rng)
        add_windows(floor, rng, ground=i == 0)
        floors.append(floor)
    return body, floors


def furnished(body: Body, floor: FloorPlan, rng: np.random.Generator) -> list[RoomSpace]:
    closed = () if body.stair_hall is None else (body.stair_hall.rect,)
    done = []
    for number, room in enumerate(floor.spaces):
        holes = [h for h in floor.holes if number in h.rooms]
        space = RoomSpace(room.rects, holes, closed if number == 0 else ())
        wanted = draw(room.type, room.area_m2, rng)
        if room.type == "bath" and not _has_toilet(floor, room.name) and not any(w.kind == "toilet" for w in wanted):
            wanted.append(Wanted("toilet", (0.4, 0.75, 0.7)))
        furnish(space, room.type, wanted, rng)
        done.append(space)
    return done


def _has_toilet(floor: FloorPlan, bath: str) -> bool:
    """Whether a bath's flat has a toilet besides: every flat has one."""
    return any(s.name == bath.replace(" bath", " toilet") for s in floor.spaces)


def _walls(raster: Raster, level: str) -> list[PlanWall]:
    """The outer walls, joined to a ring, and the inner ones."""
    ring = inset(raster.outline(OUTSIDE), -(OUTER_M - INNER_M) / 2)
    n = len(ring)
    walls = [
        PlanWall(
            f"{level}o{i}",
            level,
            ring[i],
            ring[(i + 1) % n],
            OUTER_M,
            at_start=f"{level}o{(i - 1) % n}",
            at_end=f"{level}o{(i + 1) % n}",
        )
        for i in range(n)
    ]
    return walls + [PlanWall(f"{level}i{i}", level, a, b, INNER_M) for i, (a, b) in enumerate(raster.inner_walls())]


def _hole_piece(hole: Hole, level: str) -> Piece:
    """A door or window; those to the outside sit in the middle of the outer wall, windows flush with its inside."""
    catalog, title, depth, foot, height = _HOLES[hole.what]
    fx, fy = FRONTS[hole.quarter]
    out = (OUTER_M - INNER_M) / 2 + max(0.0, (depth - OUTER_M) / 2) if OUTSIDE in hole.rooms else 0.0
    x, y = round(hole.x - fx * out, 3), round(hole.y - fy * out, 3)
    size = (hole.width_m, depth, height)
    return Piece(title, level, catalog, "", x, y, foot, size, hole.quarter * math.pi / 2, is_opening=True)


def _piece(p: Placed, level: str) -> Piece:
    return Piece(
        p.kind.capitalize(), level, PIECES[p.kind].catalog, "", p.x, p.y, p.z_m, p.size_m, p.quarter * math.pi / 2
    )


#: Flights lie side by side in the stair hall, those from even floors in the first lane: (from, to) along the corridor.
_LANES = ((0.2, 0.2 + STAIR_WIDTH_M), (0.35 + STAIR_WIDTH_M, 0.35 + 2 * STAIR_WIDTH_M))
_STAIR_FOOT_M = 0.45


def flight_rect(body: Body, floor: int) -> Rect:
    """The footprint of the flight from a floor to the next."""
    assert body.stair_hall is not None
    s0, s1 = _LANES[floor % 2]
    return body.stair_hall.cell(round(s0, 3), round(s1, 3), _STAIR_FOOT_M, _STAIR_FOOT_M + STAIR_RUN_M)


def _stair_piece(body: Body, floor: int, level: str) -> Piece:
    """A straight flight that climbs away from the corridor."""
    assert body.stair_hall is not None
    r = flight_rect(body, floor)
    quarter = {"south": 0, "east": 1, "north": 2, "west": 3}[body.stair_hall.corridor]
    x, y, size = (r.x0 + r.x1) / 2, (r.y0 + r.y1) / 2, (STAIR_WIDTH_M, STAIR_RUN_M, _FLOOR_M + 1.0)
    yaw_rad = quarter * math.pi / 2
    return Piece("Staircase", level, "eTeks#staircase", "", x, y, 0.0, size, yaw_rad, stair_cut="M0,0 v1 h1 v-1 z")


def _rails(body: Body, floor: int, floors: int, level: str) -> list[PlanWall]:
    """A low wall around the hole that the flight from below leaves, open where one steps off."""
    hall = body.stair_hall
    if floor == 0 or hall is None:
        return []
    s0, s1 = _LANES[(floor - 1) % 2]
    low, high = _STAIR_FOOT_M, _STAIR_FOOT_M + STAIR_RUN_M
    lines = [((s0 - 0.04, low), (s1 + 0.04, low)), ((s1 + 0.04, low), (s1 + 0.04, high - 0.2))]
    if s0 > 0.5:
        lines.append(((s0 - 0.04, low), (s0 - 0.04, high - 0.2)))
    walls = []
    for k, ((a, b), (c, d)) in enumerate(lines):
        p, q = hall.cell(a, a + 1, b, b + 1), hall.cell(c, c + 1, d, d + 1)
        start, end = _corner(hall.corridor, p), _corner(hall.corridor, q)
        walls.append(PlanWall(f"{level}r{k}", level, start, end, 0.05, _RAIL_M, _RAIL_M))
    return walls


def _corner(side: str, r: Rect) -> tuple[float, float]:
    """The corner of a cell where its ``s`` and ``t`` begin."""
    return {"south": (r.x0, r.y0), "north": (r.x0, r.y1), "west": (r.x0, r.y0), "east": (r.x1, r.y0)}[side]
