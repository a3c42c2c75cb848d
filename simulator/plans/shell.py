"""The shell of a plan: floors, rooms and walls."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import BuildingError
from surveilnav.simulator.archive import Archive, decode_picture
from surveilnav.simulator.plans.ground import find_ground, without_voids
from surveilnav.simulator.plans.openings import is_door, is_stairs, opening_of, stair_cut_outline
from surveilnav.simulator.plans.placing import seeded
from surveilnav.simulator.plans.plan import Wall, build_wall, wall_outline
from surveilnav.simulator.plans.slabs import build_skirt, build_slab, build_slabs
from surveilnav.simulator.plans.storeys import at_one_altitude, is_low_or_roof, is_upper, number_storeys, why_no_storey
from surveilnav.simulator.plans.straight_walls import WallPart, joined, near, parts_of
from surveilnav.simulator.plans.sweethome import Color, Home, Level, Picture, Piece, PlanRoom
from surveilnav.simulator.render.textures import TILE_M, floor_kind, floor_material, wall_material
from surveilnav.simulator.world.assembly import Mesh, SceneBuilder
from surveilnav.simulator.world.polygons import Polygon, contains, signed_area
from surveilnav.simulator.world.scene import Floor, Material, Room

_EDGE = Material("edge", (0.85, 0.84, 0.82))
_CEILING = Material("ceiling", (0.95, 0.95, 0.94))
_SILL = Material("threshold", (0.55, 0.48, 0.40))
#: Ground that nobody drew lies this much lower than rooms, and its ceiling higher: where both are, the room is seen [m].
_BEHIND_M = 0.005
#: Where rooms with a ceiling have this share of the area of those without, ceilings were hidden on purpose.
_SHOWN = 0.25

#: Limits for plans from strangers.
MAX_STAIRS = 64
MAX_STRAIGHT_WALLS = 20_000


class Shell:
    """Builds floors, rooms and walls of a plan into ``builder``; ``homes`` adds the furniture.

    Raises:
        BuildingError: more stairs or walls than the limits.
    """

    def __init__(self, home: Home, name: str, seed: int, archive: Archive | None) -> None:
        self.home, self.name, self.seed, self.archive = home, name, seed, archive
        self.builder = SceneBuilder(f"{name}-s{seed}")
        self.levels = {level.id: level for level in home.levels}
        if not self.levels:
            self.levels = {"": Level("", "Ground floor", 0.0, home.wall_height_m, 0.12)}
        self.lowest = min(self.levels.values(), key=lambda level: level.z_m)
        self.storeys: set[str] = set()
        self.floor_of_level: dict[str, str] = {}
        self.rooms: list[_DrawnRoom] = []
        self.cuts: list[tuple[NDArray[np.float64], float, float]] = []
        self.meshes: list[Mesh] = []
        self._with_ceilings = _levels_with_ceilings(home.rooms)
        self._paint: dict[Color | None, Material] = {}
        self._pictures: dict[str, Material | None] = {}

    def build_shell(self) -> None:
        """Floors, then rooms, then walls, then the ground that lies between those."""
        self.storeys = self._find_storeys()
        self.builder.floors, self.floor_of_level = number_storeys(list(self.levels.values()), self.storeys)
        self.cuts = [self._cut(piece) for piece in self.home.pieces if is_stairs(piece)]
        if len(self.cuts) > MAX_STAIRS:
            raise BuildingError(f"{self.name} has {len(self.cuts)} staircases; at most {MAX_STAIRS}")
        self._build_rooms()
        walls, names = self._straight_walls()
        outlines = [wall_outline(walls, index) for index in range(len(walls))]
        self._build_walls(walls, names, outlines)
        for floor in self.builder.floors:
            self._build_ground(floor, outlines, [self._level(level) for _, level in names])

    def _rng(self, what: str) -> np.random.Generator:
        return seeded(f"{self.seed}|{self.name}|{what}")

    def _level(self, level_id: str) -> Level:
        return self.levels.get(level_id, self.lowest)

    def _find_storeys(self) -> set[str]:
        """Ids of the levels that are floors; what else has rooms or walls is noted with the reason."""
        rooms = {self._level(room.level).id for room in self.home.rooms if len(room.outline_m) >= 3}
        walled = {self._level(wall.level).id for wall in self.home.walls}
        furnished = {self._level(p.level).id for p in self.home.pieces if not p.is_opening or is_door(p)}
        top_m = max((self.levels[level].z_m for level in rooms | (walled & furnished)), default=0.0)
        why_not = {
            id_: why_no_storey(
                level, roomed=id_ in rooms, walled=id_ in walled, furnished=id_ in furnished, is_below=level.z_m < top_m
            )
            for id_, level in self.levels.items()
        }
        if all(why_not.values()):  # a plan has a floor: walls alone, say
            levels = sorted(self.levels.values(), key=lambda level: (is_low_or_roof(level), level.z_m))
            why_not[next((level for level in levels if level.id in walled), levels[0]).id] = ""
        storeys = {id_ for id_, why in why_not.items() if not why}
        altitudes = [self.levels[id_].z_m for id_ in storeys]
        for id_, level in self.levels.items():
            apart = not any(at_one_altitude(level.z_m, z_m) for z_m in altitudes)
            if apart and id_ in rooms | walled:
                self.builder.notes.append(f"level {level.name or id_!r} is no floor: {why_not[id_]}")
        return storeys

    def _cut(self, piece: Piece) -> tuple[NDArray[np.float64], float, float]:
        """Outline, foot and top of a staircase."""
        z = self._level(piece.level).z_m + piece.z_m
        return stair_cut_outline(piece), z, z + piece.size_m[2]

    def _holes_at(self, z_m: float) -> list[NDArray[np.float64]]:
        return [outline for outline, low, high in self.cuts if low + 0.5 < z_m < high]

    # -- rooms and ground -----------------------------------------------------------------------------------------

    def _build_rooms(self) -> None:
        coverings: dict[str, tuple[Material, float, float]] = {}
        for number, plan in enumerate(self.home.rooms):
            if len(plan.outline_m) < 3:
                continue
            level = self._level(plan.level)
            outline = np.array(plan.outline_m)
            title = plan.name or f"Room {number + 1}"
            self._record_room(title, outline, level, plan.floor, plan.ceiling or plan.level not in self._with_ceilings)
            if plan.floor:
                self._build_floor(outline, level, title, self._covering(plan, title, coverings))
            if plan.ceiling:
                z = level.z_m + level.height_m
                color = plan.ceiling_color
                paint = Material("ceiling", color) if color is not None and min(color) > 0.5 else _CEILING
                slab = build_slab(outline, z, paint, self._holes_at(z), up=False)
                self._add(slab, f"Ceiling of {title}", "ceiling", level, room=title)

    def _record_room(self, title: str, outline: Polygon, level: Level, has_floor: bool, is_roofed: bool) -> None:
        """Records a room, so that furniture is told its room. A room with a floor becomes one of the building's."""
        self.rooms.append(_DrawnRoom(title, level.z_m, outline, has_floor, is_roofed))
        floor = self.builder.floor(self.floor_of_level[level.id])
        if has_floor and at_one_altitude(level.z_m, floor.z_m):
            self.builder.rooms.append(Room(title, floor.id, tuple((float(x), float(y)) for x, y in outline)))

    def _rooms_at(self, z_m: float) -> list[_DrawnRoom]:
        return [room for room in self.rooms if at_one_altitude(room.z_m, z_m)]

    def _build_ground(self, floor: Floor, walls: Sequence[Polygon], levels: Sequence[Level]) -> None:
        """Floor and ceiling where the storey's walls enclose what no room covers."""
        own = [
            (outline, level)
            for outline, level in zip(walls, levels, strict=True)
            if at_one_altitude(level.z_m, floor.z_m) and (level.id in self.storeys or not is_low_or_roof(level))
        ]
        if not own:
            return
        level = own[0][1]
        # On an upper storey a room without a floor is open to below, as are staircases.
        upper = is_upper(floor)
        rooms = [room.outline for room in self._rooms_at(floor.z_m) if room.has_floor or upper]
        holes = self._holes_at(floor.z_m)
        try:
            parts = find_ground([outline for outline, _ in own], [*rooms, *holes])
        except BuildingError as error:
            self.builder.notes.append(f"level {floor.id}: {error}")
            return
        if upper:
            below = [f.z_m for f in self.builder.floors if f.z_m < floor.z_m]
            under = [room.outline for room in self._rooms_at(max(below, default=floor.z_m))]
            parts = without_voids(parts, rooms, holes, under)
        areas = [part for part in parts if part.is_area]
        strips = [tile for part in parts if not part.is_area for tile in part.tiles]
        known: dict[str, tuple[Material, float, float]] = {}
        where = level.name or floor.name
        for number, part in enumerate(areas, start=1):
            title = f"Unnamed area{f' {number}' if len(areas) > 1 else ''} on {where}"
            self._record_room(title, part.outline, level, has_floor=True, is_roofed=True)
            self._build_tiles(part.tiles, level, title, known)
        self._build_tiles(strips, level, f"the gaps between rooms on {where}", known)

    def _build_tiles(
        self,
        tiles: Sequence[Polygon],
        level: Level,
        title: str,
        known: dict[str, tuple[Material, float, float]],
    ) -> None:
        """Floor and ceiling of tiles; no ceiling where the plan hides those of all the level's rooms."""
        self._lay_floor(tiles, level.z_m - _BEHIND_M, level, title, self._covering(None, title, known))
        plans = {plan.level for plan in self.home.rooms if self._level(plan.level).id == level.id}
        if not plans or plans & self._with_ceilings:
            z = level.z_m + level.height_m
            ceiling = build_slabs(tiles, z + _BEHIND_M, _CEILING, self._holes_at(z), up=False)
            self._add(ceiling, f"Ceiling of {title}", "ceiling", level, room=title)

    def _build_floor(
        self, outline: NDArray[np.float64], level: Level, title: str, covering: tuple[Material, float, float]
    ) -> None:
        """A room's floor, with the holes of staircases and their edges."""
        self._lay_floor([outline], level.z_m, level, title, covering)
        for hole in self._holes_at(level.z_m):
            if contains(outline, hole.mean(axis=0)):
                edge = build_skirt(hole, level.z_m - max(level.slab_m, 0.01), level.z_m, _EDGE)
                self._add(edge, f"Edge of {title}", "floor", level, room=title)

    def _lay_floor(
        self,
        polygons: Sequence[Polygon],
        z_m: float,
        level: Level,
        title: str,
        covering: tuple[Material, float, float],
    ) -> None:
        """A floor of polygons at ``z_m``, without the level's stairwells."""
        material, tile_u, tile_v = covering
        slab = build_slabs(polygons, z_m, material, self._holes_at(level.z_m), up=True)
        slab.uvs[...] /= np.array([tile_u, tile_v], np.float32)
        self._add(slab, f"Floor of {title}", "floor", level, room=title)

    def _covering(
        self, plan: PlanRoom | None, title: str, known: dict[str, tuple[Material, float, float]]
    ) -> tuple[Material, float, float]:
        """The room's own texture, else one by its name and the seed: rooms of one kind share it."""
        if plan is not None and plan.floor_picture is not None:
            own = self._picture_material(plan.floor_picture)
            if own is not None:
                return own, plan.floor_picture.width_m, plan.floor_picture.height_m
        rng = self._rng(f"floor|{re.sub(r'[^a-z]', '', title.lower())}")
        kind = floor_kind(title, rng)
        key = f"{kind}{int(rng.integers(2))}"
        if key not in known:
            known[key] = (floor_material(kind, self._rng(f"covering|{key}")), TILE_M[kind], TILE_M[kind])
        return known[key]

    # -- walls ----------------------------------------------------------------------------------------------------

    def _build_walls(
        self, walls: Sequence[Wall], names: Sequence[tuple[str, str]], outlines: Sequence[Polygon]
    ) -> None:
        # A tall window may reach through a wall of the level above: openings count by height, not by level.
        openings = [opening_of(piece, self._level(piece.level).z_m) for piece in self.home.pieces if piece.is_opening]
        for wall, (title, level_id), outline in zip(walls, names, outlines, strict=True):
            level = self._level(level_id)
            mesh, thresholds = build_wall(wall, outline, near(wall, openings))
            self._scale_pictures(mesh)
            self._add(mesh, title, "wall", level)
            if thresholds:
                floors = [room.outline for room in self._rooms_at(level.z_m) if room.has_floor]
            for quad in thresholds:  # whatever of it no room covers
                self._add(build_slab(quad, level.z_m, _SILL, floors, up=True), f"Threshold of {title}", "floor", level)

    def _straight_walls(self) -> tuple[list[Wall], list[tuple[str, str]]]:
        """All walls, arcs cut into straight ones; with (title, level) of each."""
        parts: list[WallPart] = []
        by_id: dict[str, list[int]] = {}
        for plan in self.home.walls:
            straight = parts_of(plan, self._level(plan.level).height_m)
            by_id.setdefault(plan.id, []).extend(range(len(parts), len(parts) + len(straight)))
            parts += straight
            if len(parts) > MAX_STRAIGHT_WALLS:
                raise BuildingError(f"{self.name} has more than {MAX_STRAIGHT_WALLS} walls, arcs cut straight: refused")
        joinable = {**by_id, "": []}  # "": joined to none
        walls: list[Wall] = []
        names: list[tuple[str, str]] = []
        for index, part in enumerate(parts):
            plan, own = part.plan, by_id[part.plan.id]
            walls.append(
                Wall(
                    part.start,
                    part.end,
                    plan.thickness_m,
                    part.height_m,
                    part.end_height_m,
                    self._level(plan.level).z_m,
                    self._wall_paint(plan.left, plan.left_picture),
                    self._wall_paint(plan.right, plan.right_picture),
                    joined(parts, joinable.get(plan.at_start, []), part.start) if index == own[0] else index - 1,
                    joined(parts, joinable.get(plan.at_end, []), part.end) if index == own[-1] else index + 1,
                )
            )
            names.append((f"Wall {plan.id or len(walls)}", plan.level))
        return walls, names

    def _wall_paint(self, color: Color | None, picture: Picture | None) -> Material:
        if picture is not None:
            own = self._picture_material(picture)
            if own is not None:
                return own
        if color is not None and max(color) < 0.1:
            color = None  # Near black is how old files say "none"; a dark cave teaches a detector nothing.
        if color not in self._paint:
            self._paint[color] = wall_material(self._rng(f"wall|{color}"), color)
        return self._paint[color]

    def _picture_material(self, picture: Picture) -> Material | None:
        """A texture from the file itself; None where it can't be had. Its name carries how much it covers."""
        key = f"picture:{picture.path}:{picture.width_m}:{picture.height_m}"
        if key not in self._pictures:
            data = self.archive.read(picture.path) if self.archive is not None and picture.path else None
            decoded = decode_picture(data) if data else None
            self._pictures[key] = Material(key, (1.0, 1.0, 1.0), decoded[0]) if decoded else None
        return self._pictures[key]

    def _scale_pictures(self, mesh: Mesh) -> None:
        """Wall coordinates are metres: divide by what a picture covers."""
        for index, material in enumerate(mesh.materials):
            if material.name.startswith("picture:"):
                _, _, width, height = material.name.rsplit(":", 3)
                mesh.uvs[mesh.material == index] /= np.array([float(width), float(height)], np.float32)

    def _room_at(self, piece: Piece, level: Level) -> str:
        p = np.array([piece.x_m, piece.y_m])
        return next((room.name for room in self._rooms_at(level.z_m) if contains(room.outline, p)), "")

    def _add(self, mesh: Mesh, name: str, label: str, level: Level, *, model: str = "", room: str = "") -> None:
        if self.builder.add(mesh, name, label, self.floor_of_level[level.id], model=model, room=room):
            self.meshes.append(mesh)


class _DrawnRoom(NamedTuple):
    """A room as it is drawn, or an area that nobody drew."""

    name: str
    z_m: float
    outline: Polygon
    has_floor: bool
    is_roofed: bool  # by its ceiling, or hidden as all of its level are


def _levels_with_ceilings(rooms: Sequence[PlanRoom]) -> set[str]:
    """Ids of the levels on which a room with a hidden ceiling is a terrace or a void.

    On other levels nearly all ceilings are hidden, so a hidden one says nothing about its room.
    """
    area_m2: dict[tuple[str, bool], float] = {}
    for room in rooms:
        key = room.level, room.ceiling
        area_m2[key] = area_m2.get(key, 0.0) + abs(signed_area(np.array(room.outline_m).reshape(-1, 2)))
    return {
        level for level, shown in area_m2 if shown and area_m2[level, True] >= _SHOWN * area_m2.get((level, False), 0.0)
    }
