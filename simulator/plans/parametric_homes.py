"""Two homes of our own, with furniture made of boxes: they need no assets and build in a moment.

``parametric_flat``: one floor of 10 x 8 m, five rooms. ``parametric_house``: two such floors and a stair.
The plan is the same for every seed; colours, floor coverings and small things change.
"""

from __future__ import annotations

import math
from functools import lru_cache
from importlib import resources

import msgspec
import numpy as np

from surveilnav.simulator.furniture.parametric import SIZES_M, parametric_piece, stair_flight
from surveilnav.simulator.plans.plan import Opening, Point, Wall, build_wall, wall_outline
from surveilnav.simulator.plans.slabs import build_skirt, build_slab
from surveilnav.simulator.render.textures import TILE_M, floor_kind, floor_material, wall_material
from surveilnav.simulator.world.assembly import SceneBuilder
from surveilnav.simulator.world.scene import Floor, Material, Room, Scene, Stair

ROOM_HEIGHT_M = 2.5
SLAB_M = 0.12
_OUTER_M, _INNER_M = 0.2, 0.1

#: The stair of the house: (x, y) of the first tread's edge, run along +x, width.
_STAIR_FOOT = (1.1, 0.65)
_STAIR_RUN_M, _STAIR_WIDTH_M, _STEPS = 2.64, 0.9, 12

_Piece = tuple[str, float, float, int, float]
_Hole = tuple[float, float, bool, float, float, float]


class _FloorPlan(msgspec.Struct, frozen=True):
    """One floor: its name, the names of its rooms, and its furniture."""

    name: str
    rooms: dict[str, str]
    pieces: list[_Piece]


class _Plan(msgspec.Struct, frozen=True):
    """``data/parametric_homes.json``, which says what the numbers are."""

    rooms: dict[str, tuple[float, float, float, float]]
    inner_walls: list[tuple[Point, Point]]
    doors: list[_Hole]
    windows: list[_Hole]
    floors: list[_FloorPlan]


@lru_cache(maxsize=1)
def _plan() -> _Plan:
    text = resources.files("surveilnav.simulator.plans").joinpath("data/parametric_homes.json").read_bytes()
    return msgspec.json.decode(text, type=_Plan)


def parametric_flat(seed: int = 0) -> Scene:
    """One floor, 10 x 8 m: living room, kitchen, hall, bedroom, bathroom, study; all six targets."""
    builder = SceneBuilder(f"parametric_flat-s{seed}")
    rng = np.random.default_rng([seed, 1])
    _add_floor(builder, "0", 0.0, _plan().floors[0], rng)
    builder.credits.append("parametric furniture: SurveilNav, Apache-2.0")
    return builder.build("parametric_flat: written in code, no assets")


def parametric_house(seed: int = 0) -> Scene:
    """Two floors and a stair of 12 treads; the same targets below, beds, couch, tv and plants above."""
    builder = SceneBuilder(f"parametric_house-s{seed}")
    rng = np.random.default_rng([seed, 2])
    rise = ROOM_HEIGHT_M + SLAB_M
    hole = _stair_hole()
    ground, upper = _plan().floors
    _add_floor(builder, "0", 0.0, ground, rng, ceiling_holes=(hole,))
    _add_floor(builder, "1", rise, upper, rng, floor_holes=(hole,))
    _add_stair(builder, rise)
    builder.credits.append("parametric furniture: SurveilNav, Apache-2.0")
    return builder.build("parametric_house: written in code, no assets")


def _stair_hole() -> np.ndarray:
    (x, y), half = _STAIR_FOOT, _STAIR_WIDTH_M / 2
    return np.array(
        [(x - 0.05, y - half), (x + _STAIR_RUN_M, y - half), (x + _STAIR_RUN_M, y + half), (x - 0.05, y + half)]
    )


def _add_stair(builder: SceneBuilder, rise_m: float) -> None:
    """The flight and the transit over it."""
    x, y = _STAIR_FOOT
    T = np.eye(4)
    T[:2, 3] = _STAIR_FOOT
    flight = stair_flight(_STAIR_WIDTH_M, _STAIR_RUN_M, rise_m, _STEPS).moved(T)
    builder.add(flight, "Stairs", "stairs", "0", model="parametric/stairs", room="Living room")
    foot, head = (x - 0.45, y, 0.0), (x + _STAIR_RUN_M + 0.45, y, rise_m)
    builder.stairs.append(Stair("0", "1", foot, head, math.hypot(_STAIR_RUN_M, rise_m) + 0.9))


def _add_floor(
    builder: SceneBuilder,
    floor: str,
    z_m: float,
    plan: _FloorPlan,
    rng: np.random.Generator,
    floor_holes: tuple[np.ndarray, ...] = (),
    ceiling_holes: tuple[np.ndarray, ...] = (),
) -> None:
    """One floor: shell, rooms, furniture. Where stairs come up through it, railings stand around the hole."""
    builder.floors.append(Floor(floor, plan.name, z_m, ROOM_HEIGHT_M))
    paint, white = wall_material(rng), Material("ceiling", (0.95, 0.95, 0.94))
    _add_walls(builder, floor, z_m, paint)
    if floor_holes:
        _add_railings(builder, floor, z_m, paint)
    for key, (x0, y0, x1, y1) in _plan().rooms.items():
        # Floors reach to the centre lines of the walls: no gap in a doorway.
        outline = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
        room = plan.rooms[key]
        builder.rooms.append(Room(room, floor, outline))
        kind = floor_kind(room, rng)
        covering = floor_material(kind, rng)
        slab = build_slab(np.array(outline), z_m, covering, floor_holes, up=True, tile_m=TILE_M[kind])
        builder.add(slab, f"Floor of {room}", "floor", floor, room=room)
        top = build_slab(np.array(outline), z_m + ROOM_HEIGHT_M, white, ceiling_holes, up=False)
        builder.add(top, f"Ceiling of {room}", "ceiling", floor, room=room)
    for hole in floor_holes:
        builder.add(build_skirt(hole, z_m - SLAB_M, z_m, white), "Edge of the stair hole", "floor", floor)
    for piece in plan.pieces:
        _add_piece(builder, floor, z_m, plan, piece, rng)


def _add_walls(builder: SceneBuilder, floor: str, z_m: float, paint: Material) -> None:
    """A clockwise ring of outer walls (joined head to tail, so that they are mitred), then the inner ones."""
    openings = [
        Opening((x, y), 0.0 if along_x else math.pi / 2, width, 0.4, z_m + z0, z_m + z1)
        for x, y, along_x, width, z0, z1 in (*_plan().doors, *_plan().windows)
    ]
    height = (ROOM_HEIGHT_M, ROOM_HEIGHT_M, z_m, paint, paint)
    ring: tuple[Point, ...] = ((0.0, 0.0), (0.0, 8.0), (10.0, 8.0), (10.0, 0.0))
    walls = [Wall(ring[i], ring[(i + 1) % 4], _OUTER_M, *height, (i - 1) % 4, (i + 1) % 4) for i in range(4)]
    walls += [Wall(a, b, _INNER_M, *height) for a, b in _plan().inner_walls]
    for index, wall in enumerate(walls):
        mesh, _ = build_wall(wall, wall_outline(walls, index), openings)
        builder.add(mesh, f"Wall {index + 1}", "wall", floor)


def _add_railings(builder: SceneBuilder, floor: str, z_m: float, paint: Material) -> None:
    """Beside the stair hole and at its foot."""
    (x, y), half = _STAIR_FOOT, _STAIR_WIDTH_M / 2
    beside = (x - 0.1, y + half + 0.04), (x + _STAIR_RUN_M, y + half + 0.04)
    at_foot = (x - 0.08, y - half), (x - 0.08, y + half)
    for start, end in (beside, at_foot):
        rail = Wall(start, end, 0.06, 0.9, 0.9, z_m, paint, paint)
        builder.add(build_wall(rail, wall_outline([rail], 0), [])[0], "Railing", "wall", floor)


def _add_piece(
    builder: SceneBuilder, floor: str, z_m: float, plan: _FloorPlan, piece: _Piece, rng: np.random.Generator
) -> None:
    """A piece of furniture where its line of the table puts it."""
    label, x, y, quarter_turns, above = piece
    T = np.eye(4)
    c, s = round(math.cos(quarter_turns * math.pi / 2)), round(math.sin(quarter_turns * math.pi / 2))
    T[:2, :2] = [[c, -s], [s, c]]
    T[:3, 3] = (x, y, z_m + above)
    room = next((plan.rooms[k] for k, (x0, y0, x1, y1) in _plan().rooms.items() if x0 <= x < x1 and y0 <= y < y1), "")
    mesh = parametric_piece(label, SIZES_M[label], rng).moved(T)
    detectable = "" if label in ("bathtub", "bookshelf", "lamp", "cabinet", "rug") else label
    model = f"parametric/{label.replace(' ', '_')}"
    builder.add(mesh, label.capitalize(), detectable, floor, model=model, room=room)
