"""The shell of a plan: floors, rooms and walls."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulator.archive import Archive, decode_picture
from simulator.furniture.placing import seeded
from simulator.plans.assembly import Mesh, SceneBuilder
from simulator.plans.openings import is_stairs, opening_of, stair_cut_outline
from simulator.plans.plan import Opening, Wall, build_skirt, build_slab, build_wall, wall_outline
from simulator.plans.polygons import contains
from simulator.plans.sweethome import Color, Home, Level, Picture, Piece, PlanRoom, PlanWall
from simulator.render.textures import TILE_M, floor_kind, floor_material, wall_material
from simulator.world.scene import Floor, Material, Room
from surveilnav.errors import BuildingError

#: An arc wall becomes straight pieces that span at most this angle.
_ARC_STEP_RAD = math.pi / 16

_EDGE = Material("edge", (0.85, 0.84, 0.82))

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
        self.floor_of_level: dict[str, str] = {}
        self.rooms: dict[str, list[tuple[Room, NDArray[np.float64]]]] = {}
        self.cuts: list[tuple[NDArray[np.float64], float, float]] = []
        self.meshes: list[Mesh] = []
        self._paint: dict[Color | None, Material] = {}
        self._pictures: dict[str, Material | None] = {}

    def build_shell(self) -> None:
        """Floors, then rooms, then walls."""
        self._number_floors()
        self.cuts = [self._cut(piece) for piece in self.home.pieces if is_stairs(piece)]
        if len(self.cuts) > MAX_STAIRS:
            raise BuildingError(f"{self.name} has {len(self.cuts)} staircases; at most {MAX_STAIRS}")
        self._build_rooms()
        self._build_walls()

    def _rng(self, what: str) -> np.random.Generator:
        return seeded(f"{self.seed}|{self.name}|{what}")

    def _level(self, level_id: str) -> Level:
        return self.levels.get(level_id, self.lowest)

    # -- floors ---------------------------------------------------------------------------------------------------

    def _number_floors(self) -> None:
        """Levels with rooms become floors: "0" on the ground, "1" above, "B1" below; roofs are part of those."""
        with_rooms = {self._level(room.level).id for room in self.home.rooms if len(room.outline_m) >= 3}
        ordered = sorted(self.levels.values(), key=lambda level: level.z_m)
        floors: list[list[Level]] = []
        for level in ordered:
            if level.id not in with_rooms or re.search(r"\broof\b", level.name, re.IGNORECASE):
                continue
            if floors and level.z_m - floors[-1][0].z_m < 0.1:
                floors[-1].append(level)
            else:
                floors.append([level])
        if not floors:
            floors = [[ordered[0]]]
        ground = next((i for i, group in enumerate(floors) if group[0].z_m > -0.3), len(floors) - 1)
        for i, group in enumerate(floors):
            floor_id = str(i - ground) if i >= ground else f"B{ground - i}"
            first = group[0]
            self.builder.floors.append(Floor(floor_id, first.name or floor_id, first.z_m, first.height_m))
        for level in ordered:
            below = [f for f in self.builder.floors if f.z_m <= level.z_m + 0.1]
            self.floor_of_level[level.id] = (below[-1] if below else self.builder.floors[0]).id

    def _cut(self, piece: Piece) -> tuple[NDArray[np.float64], float, float]:
        """Outline, foot and top of a staircase."""
        z = self._level(piece.level).z_m + piece.z_m
        return stair_cut_outline(piece), z, z + piece.size_m[2]

    def _holes_at(self, z_m: float) -> list[NDArray[np.float64]]:
        return [outline for outline, low, high in self.cuts if low + 0.5 < z_m < high]

    # -- shell ----------------------------------------------------------------------------------------------------

    def _build_rooms(self) -> None:
        white = Material("ceiling", (0.95, 0.95, 0.94))
        coverings: dict[str, tuple[Material, float, float]] = {}
        for number, plan in enumerate(self.home.rooms):
            if len(plan.outline_m) < 3:
                continue
            level = self._level(plan.level)
            floor = self.floor_of_level[level.id]
            outline = np.array(plan.outline_m)
            title = plan.name or f"Room {number + 1}"
            room = Room(title, floor, plan.outline_m)
            self.rooms.setdefault(level.id, []).append((room, outline))
            if plan.floor:
                self.builder.rooms.append(room)
                self._build_floor(outline, level, title, self._covering(plan, title, coverings))
            if plan.ceiling:
                z = level.z_m + level.height_m
                color = plan.ceiling_color
                paint = Material("ceiling", color) if color is not None and min(color) > 0.5 else white
                slab = build_slab(outline, z, paint, self._holes_at(z), up=False)
                self._add(slab, f"Ceiling of {title}", "ceiling", level, room=title)

    def _build_floor(
        self, outline: NDArray[np.float64], level: Level, title: str, covering: tuple[Material, float, float]
    ) -> None:
        """A room's floor, with the holes of staircases and their edges."""
        material, tile_u, tile_v = covering
        holes = self._holes_at(level.z_m)
        slab = build_slab(outline, level.z_m, material, holes, up=True)
        slab.uvs[...] /= np.array([tile_u, tile_v], np.float32)
        self._add(slab, f"Floor of {title}", "floor", level, room=title)
        for hole in holes:
            if contains(outline, hole.mean(axis=0)):
                edge = build_skirt(hole, level.z_m - max(level.slab_m, 0.01), level.z_m, _EDGE)
                self._add(edge, f"Edge of {title}", "floor", level, room=title)

    def _covering(
        self, plan: PlanRoom, title: str, known: dict[str, tuple[Material, float, float]]
    ) -> tuple[Material, float, float]:
        """The room's own texture, else one by its name and the seed: rooms of one kind share it."""
        if plan.floor_picture is not None:
            own = self._picture_material(plan.floor_picture)
            if own is not None:
                return own, plan.floor_picture.width_m, plan.floor_picture.height_m
        rng = self._rng(f"floor|{re.sub(r'[^a-z]', '', title.lower())}")
        kind = floor_kind(title, rng)
        key = f"{kind}{int(rng.integers(2))}"
        if key not in known:
            known[key] = (floor_material(kind, self._rng(f"covering|{key}")), TILE_M[kind], TILE_M[kind])
        return known[key]

    def _build_walls(self) -> None:
        walls, names = self._straight_walls()
        # A tall window may reach through a wall of the level above: openings count by height, not by level.
        openings = [opening_of(piece, self._level(piece.level).z_m) for piece in self.home.pieces if piece.is_opening]
        for index, (wall, (title, level_id)) in enumerate(zip(walls, names, strict=True)):
            level = self._level(level_id)
            mesh, thresholds = build_wall(wall, wall_outline(walls, index), _near(wall, openings))
            self._scale_pictures(mesh)
            self._add(mesh, title, "wall", level)
            for _, quad in thresholds:
                if not any(contains(outline, quad.mean(axis=0)) for _, outline in self.rooms.get(level.id, [])):
                    sill = build_slab(quad, level.z_m, Material("threshold", (0.55, 0.48, 0.40)), up=True)
                    self._add(sill, f"Threshold of {title}", "floor", level)

    def _straight_walls(self) -> tuple[list[Wall], list[tuple[str, str]]]:
        """All walls, arcs cut into straight ones; with (title, level) of each."""
        parts: list[_Part] = []
        by_id: dict[str, list[int]] = {}
        for plan in self.home.walls:
            straight = self._parts_of(plan)
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
                    part.start, part.end, plan.thickness_m, part.height_m, part.end_height_m,
                    self._level(plan.level).z_m, self._wall_paint(plan.left, plan.left_picture),
                    self._wall_paint(plan.right, plan.right_picture),
                    _joined(parts, joinable.get(plan.at_start, []), part.start) if index == own[0] else index - 1,
                    _joined(parts, joinable.get(plan.at_end, []), part.end) if index == own[-1] else index + 1,
                )
            )  # fmt: skip
            names.append((f"Wall {plan.id or len(walls)}", plan.level))
        return walls, names

    def _parts_of(self, plan: PlanWall) -> list[_Part]:
        """The straight walls that a wall of the plan consists of, start to end."""
        height = plan.height_m if plan.height_m is not None else self._level(plan.level).height_m
        end_height = plan.end_height_m if plan.end_height_m is not None else height
        points = _arc_points(plan) if plan.arc_rad else [plan.start_m, plan.end_m]
        count = len(points) - 1
        heights = [height + (end_height - height) * i / count for i in range(count + 1)]
        return [_Part(plan, points[i], points[i + 1], heights[i], heights[i + 1]) for i in range(count)]

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
        return next((room.name for room, outline in self.rooms.get(level.id, []) if contains(outline, p)), "")

    def _add(self, mesh: Mesh, name: str, label: str, level: Level, *, model: str = "", room: str = "") -> None:
        if self.builder.add(mesh, name, label, self.floor_of_level[level.id], model=model, room=room):
            self.meshes.append(mesh)


class _Part(NamedTuple):
    """A straight part of a wall of the plan."""

    plan: PlanWall
    start: tuple[float, float]
    end: tuple[float, float]
    height_m: float
    end_height_m: float


def _joined(parts: Sequence[_Part], candidates: Sequence[int], here: tuple[float, float]) -> int | None:
    """The candidate with an end nearest to ``here``, or None where there is no candidate."""
    if not candidates:
        return None
    return min(candidates, key=lambda k: min(math.dist(here, parts[k].start), math.dist(here, parts[k].end)))


def _near(wall: Wall, openings: Sequence[Opening]) -> list[Opening]:
    """The openings that may touch a wall at all (a quick test)."""
    if not openings:
        return []
    a, along = np.array(wall.start_m), np.array(wall.end_m) - np.array(wall.start_m)
    p = np.array([o.centre_m for o in openings])
    t = np.clip((p - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    reach = np.array([o.width_m / 2 + o.depth_m for o in openings]) + wall.thickness_m
    near = np.linalg.norm(a + t[:, None] * along - p, axis=1) < reach
    return [openings[int(i)] for i in np.flatnonzero(near)]


def _arc_points(wall: PlanWall) -> list[tuple[float, float]]:
    """Points along an arc wall's centre line (``Wall.computeArcCircleCenter`` in Sweet Home 3D), start to end."""
    # In the plan's own frame: y down, the arc's angle clockwise.
    (xs, ys), (xe, ye), extent = (wall.start_m[0], -wall.start_m[1]), (wall.end_m[0], -wall.end_m[1]), -wall.arc_rad
    chord = math.dist((xs, ys), (xe, ye))
    if chord < 1e-6 or abs(extent) < 1e-3:
        return [wall.start_m, wall.end_m]
    to_center = -(math.pi + extent) / 2 if abs(extent) > math.pi else (math.pi - extent) / 2
    distance = -math.tan(to_center) * chord / 2
    normal = math.atan2(xs - xe, ye - ys)
    cx, cy = (xs + xe) / 2 + distance * math.cos(normal), (ys + ye) / 2 + distance * math.sin(normal)
    radius, first = math.hypot(xs - cx, ys - cy), math.atan2(ys - cy, xs - cx)

    def miss(turn_rad: float) -> float:
        return math.dist((cx + radius * math.cos(first + turn_rad), cy + radius * math.sin(first + turn_rad)), (xe, ye))

    turn_rad = min((extent, -extent), key=miss)
    count = max(4, math.ceil(abs(turn_rad) / _ARC_STEP_RAD))
    angles = [first + turn_rad * i / count for i in range(count + 1)]
    points = [(cx + radius * math.cos(a), -(cy + radius * math.sin(a))) for a in angles]
    points[0], points[-1] = wall.start_m, wall.end_m
    return points
