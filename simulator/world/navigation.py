"""Where a robot can stand and how far it is from there to anywhere: the simulator's navigation mesh.

Per floor, cells of 5 cm: a cell carries a robot if a floor surface lies there (a ray down from just above it finds
one) and nothing reaches into the space that the robot needs above it (all triangles between ``max_step_m`` and
``robot_height_m``, glass included). What is left is eroded by the robot's radius as Recast does for Habitat, and falls
into connected components. Stairs are transits between floors with a length of their own.

Only simulator, camera placement, the success check and the oracle planner ``sp`` may use this: it is ground truth.
"""

from __future__ import annotations

import hashlib
import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from simulator.world.geodesic import UNREACHED, first_blocked, mark_triangles, spread
from simulator.world.raycast import RayCaster
from simulator.world.scene import Scene, Stair
from surveilnav.errors import BuildingError
from surveilnav.geometry import Grid
from surveilnav.stored import replacing

#: Habitat's robot.
RADIUS_M = 0.18
#: Raised by one with every change of what is computed: old caches are then built anew.
_FORMAT = 2
_MAX_CELLS = 64_000_000


@dataclass(frozen=True, slots=True, eq=False)
class FloorNavigation:
    """One storey. All arrays have the shape of ``grid``.

    Attributes:
        free: bool, the robot's centre may stand anywhere in this cell.
        component: int32, connected part of ``free`` by number, largest first, from 1; 0 where not free.
        supported: bool, a floor surface lies here.
        indoor: bool, it has a roof over it too (or the building has none anywhere).
        obstacle: bool, something reaches into the space above it.
    """

    id: str
    z_m: float
    grid: Grid
    free: NDArray[np.bool_]
    component: NDArray[np.int32]
    supported: NDArray[np.bool_]
    indoor: NDArray[np.bool_]
    obstacle: NDArray[np.bool_]

    @property
    def largest_component(self) -> int:
        """Its number in ``component``; 0 if the robot can stand nowhere."""
        return 1 if self.free.any() else 0

    @property
    def floor_area_m2(self) -> float:
        """Area of the floor indoors, furnished or not: what camera density is counted by."""
        return float(self.indoor.sum()) * self.grid.resolution_m**2

    @property
    def free_area_m2(self) -> float:
        """Area where the robot's centre may stand."""
        return float(self.free.sum()) * self.grid.resolution_m**2


@dataclass(frozen=True, slots=True)
class Transit:
    """A stair that a robot can take: the free places (x, y, z) [m] nearest to its two ends, and its length."""

    lower_floor: str
    upper_floor: str
    lower_m: tuple[float, float, float]
    upper_m: tuple[float, float, float]
    length_m: float

    def end_on(self, floor: str) -> tuple[float, float, float]:
        """The end (x, y, z) on one of its two floors."""
        return self.lower_m if floor == self.lower_floor else self.upper_m

    def other_floor(self, floor: str) -> str:
        return self.upper_floor if floor == self.lower_floor else self.lower_floor


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A corner of a way: (x, y) [m] on a floor. Where the floor changes, the way takes a stair."""

    floor: str
    x_m: float
    y_m: float


@dataclass(frozen=True, slots=True, eq=False)
class DistanceField:
    """Geodesic distance from everywhere to the nearest of some goals.

    ``distance_m``: float32 of the floor's grid, by floor; inf where unreachable.
    """

    navigation: NavigationMap
    distance_m: dict[str, NDArray[np.float32]]
    _parent: dict[str, NDArray[np.int32]]
    _stair_of_seed: dict[str, dict[int, int]]

    def at(self, p_world: ArrayLike, floor: str) -> float:
        """Distance [m] from a point (x, y[, z]) on a floor; inf if it isn't free or no goal can be reached."""
        grid = self.navigation.floors[floor].grid
        row, col = (int(v) for v in grid.cells_of(np.asarray(p_world, dtype=np.float64)[:2]))
        if not (0 <= row < grid.rows and 0 <= col < grid.cols):
            return math.inf
        parent = int(self._parent[floor][row * grid.cols + col])
        if parent == UNREACHED:
            return math.inf
        corner = grid.centres_of(divmod(parent, grid.cols))
        x, y = np.asarray(p_world, dtype=np.float64)[:2]
        return math.hypot(corner[0] - x, corner[1] - y) + float(self.distance_m[floor].ravel()[parent])

    def path_from(self, p_world: ArrayLike, floor: str) -> list[Waypoint]:
        """The shortest way to the nearest goal, both ends included; empty if there is none."""
        if math.isinf(self.at(p_world, floor)):
            return []
        x, y = (float(v) for v in np.asarray(p_world, dtype=np.float64)[:2])
        way = [Waypoint(floor, x, y)]
        grid = self.navigation.floors[floor].grid
        row, col = (int(v) for v in grid.cells_of((x, y)))
        cell = row * grid.cols + col
        while True:
            parent = int(self._parent[floor][cell])
            px, py = self.navigation.floors[floor].grid.centres_of(divmod(parent, grid.cols))
            if (px, py) != (way[-1].x_m, way[-1].y_m):
                way.append(Waypoint(floor, float(px), float(py)))
            if parent != cell:
                cell = parent
                continue
            if cell not in self._stair_of_seed[floor]:
                return way
            transit = self.navigation.transits[self._stair_of_seed[floor][cell]]
            floor = transit.other_floor(floor)
            ex, ey, _ = transit.end_on(floor)
            grid = self.navigation.floors[floor].grid
            row, col = (int(v) for v in grid.cells_of((ex, ey)))
            cell = row * grid.cols + col
            way.append(Waypoint(floor, ex, ey))


@dataclass(frozen=True, eq=False)
class NavigationMap:
    """Traversability of a whole building. Build one with ``build`` or ``load_or_build``."""

    floors: dict[str, FloorNavigation]
    transits: tuple[Transit, ...]
    radius_m: float
    notes: tuple[str, ...] = ()

    @classmethod
    def build(
        cls,
        scene: Scene,
        *,
        radius_m: float = RADIUS_M,
        resolution_m: float = 0.05,
        robot_height_m: float = 1.0,
        max_step_m: float = 0.1,
        caster: RayCaster | None = None,
    ) -> NavigationMap:
        """Computes the map of a scene (0.2-3 s).

        Args:
            robot_height_m: clearance that the robot needs; its camera sits at 0.88 m.
            max_step_m: carpets, door sills and uneven floors up to this height are driven over.
            caster: spares building one, if there is one already.

        Raises:
            BuildingError: the building is too large for one grid.
        """
        caster = caster or RayCaster(scene)
        grid = _grid_of(scene, resolution_m)
        floors: dict[str, FloorNavigation] = {}
        for floor in scene.floors:
            supported = _supported(caster, grid, floor.z_m, max_step_m)
            obstacle = np.zeros(grid.shape, dtype=np.bool_)
            mark_triangles(
                obstacle, scene.vertices, scene.triangles, grid.origin_x_m, grid.origin_y_m, resolution_m,
                floor.z_m + max_step_m, floor.z_m + robot_height_m,
            )  # fmt: skip
            open_cells = np.pad(supported & ~obstacle, 1)
            free = (ndimage.distance_transform_edt(open_cells) * resolution_m > radius_m)[1:-1, 1:-1]
            indoor = supported & _roofed(caster, grid, floor.z_m + robot_height_m)
            floors[floor.id] = FloorNavigation(
                floor.id, floor.z_m, grid, free, _components(free), supported, indoor, obstacle
            )
        # A model without ceilings (a scan, a doll's house): tops of walls and cupboards are no roof.
        if sum((f.free & f.indoor).sum() for f in floors.values()) < 0.1 * sum(f.free.sum() for f in floors.values()):
            floors = {f.id: replace(f, indoor=f.supported) for f in floors.values()}
        return cls._with_stairs(floors, scene.stairs, radius_m)

    @classmethod
    def _with_stairs(
        cls, floors: dict[str, FloorNavigation], stairs: Sequence[Stair], radius_m: float
    ) -> NavigationMap:
        """Snaps the ends of stairs to free cells; a stair without a free place at both ends is left out and noted."""
        bare = cls(floors, (), radius_m)
        transits, notes = [], []
        for stair in stairs:
            lower = bare.snap(stair.lower_m, stair.lower_floor, min_area_m2=0.5)
            upper = bare.snap(stair.upper_m, stair.upper_floor, min_area_m2=0.5)
            if lower is None or upper is None:
                where = stair.lower_floor if lower is None else stair.upper_floor
                notes.append(f"the stair from {stair.lower_floor} to {stair.upper_floor} has no free place on {where}")
                continue
            transits.append(Transit(stair.lower_floor, stair.upper_floor, lower, upper, stair.length_m))
        return cls(floors, tuple(transits), radius_m, tuple(notes))

    @classmethod
    def load_or_build(cls, scene: Scene, cache_dir: Path | None, **settings: float) -> NavigationMap:
        """``build``, kept in ``cache_dir`` under a name made of the scene's content and the settings.

        A scene without a content hash isn't cached; a broken file is built anew.
        """
        if cache_dir is None or not scene.content_hash:
            return cls.build(scene, **settings)  # type: ignore[arg-type]
        key = repr((_FORMAT, scene.content_hash, scene.floors, scene.stairs, sorted(settings.items())))
        path = cache_dir / f"navigation-{hashlib.sha256(key.encode()).hexdigest()[:24]}.npz"
        if path.exists():
            try:
                return cls._load(path, scene, settings.get("radius_m", RADIUS_M))
            except (OSError, KeyError, ValueError, zipfile.BadZipFile):
                path.unlink(missing_ok=True)
        navigation = cls.build(scene, **settings)  # type: ignore[arg-type]
        navigation._save(path)
        return navigation

    def _save(self, path: Path) -> None:
        arrays: dict[str, NDArray] = {}
        for i, floor in enumerate(self.floors.values()):
            g = floor.grid
            arrays[f"grid{i}"] = np.array([g.origin_x_m, g.origin_y_m, g.resolution_m, g.rows, g.cols])
            for name in ("free", "supported", "indoor", "obstacle"):
                arrays[f"{name}{i}"] = np.packbits(getattr(floor, name))
        with replacing(path) as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]

    @classmethod
    def _load(cls, path: Path, scene: Scene, radius_m: float) -> NavigationMap:
        floors: dict[str, FloorNavigation] = {}
        with np.load(path, allow_pickle=False) as arrays:
            for i, floor in enumerate(scene.floors):
                x, y, resolution, rows, cols = arrays[f"grid{i}"]
                grid = Grid(float(x), float(y), float(resolution), int(rows), int(cols))
                free, supported, indoor, obstacle = (
                    np.unpackbits(arrays[f"{name}{i}"], count=grid.rows * grid.cols).reshape(grid.shape).astype(bool)
                    for name in ("free", "supported", "indoor", "obstacle")
                )
                floors[floor.id] = FloorNavigation(
                    floor.id, floor.z_m, grid, free, _components(free), supported, indoor, obstacle
                )
        return cls._with_stairs(floors, scene.stairs, radius_m)

    # ---- places ------------------------------------------------------------------------------------------------

    @cached_property
    def robot_area(self) -> dict[str, NDArray[np.bool_]]:
        """By floor, where robots live: the components that hang together over stairs with the largest area in all.

        What counts is area indoors: a terrace behind a closed door may be larger than the home.
        """
        group: dict[tuple[str, int], tuple[str, int]] = {}

        def root(node: tuple[str, int]) -> tuple[str, int]:
            while group.get(node, node) != node:
                node = group[node]
            return node

        for t in self.transits:
            a = root((t.lower_floor, self._component_at(t.lower_m, t.lower_floor)))
            b = root((t.upper_floor, self._component_at(t.upper_m, t.upper_floor)))
            group[a] = b
        area: dict[tuple[str, int], float] = {}
        for floor in self.floors.values():
            for number, cells in enumerate(
                np.bincount(floor.component[floor.indoor], minlength=int(floor.component.max()) + 1)[1:], start=1
            ):
                key = root((floor.id, number))
                area[key] = area.get(key, 0.0) + float(cells) * floor.grid.resolution_m**2
        best = max(area, key=lambda key: (area[key], key), default=None)
        result = {}
        for floor in self.floors.values():
            numbers = [n for n in range(1, int(floor.component.max()) + 1) if root((floor.id, n)) == best]
            result[floor.id] = np.isin(floor.component, numbers) & floor.free
        return result

    def _component_at(self, p_world: ArrayLike, floor: str) -> int:
        f = self.floors[floor]
        row, col = (int(v) for v in f.grid.cells_of(np.asarray(p_world, dtype=np.float64)[:2]))
        return int(f.component[row, col]) if 0 <= row < f.grid.rows and 0 <= col < f.grid.cols else 0

    def is_navigable(self, p_world: ArrayLike, floor: str) -> bool:
        """Whether the robot's centre may stand at (x, y[, z]) on ``floor``."""
        return self._component_at(p_world, floor) > 0

    def snap(
        self,
        p_world: ArrayLike,
        floor: str,
        component: int | None = None,
        *,
        within_m: float = 1.0,
        min_area_m2: float = 0.0,
    ) -> tuple[float, float, float] | None:
        """The nearest navigable place (x, y, z) [m] within ``within_m``, or None.

        ``component`` asks for a certain one, ``min_area_m2`` for one that isn't just a gap between furniture.
        """
        f = self.floors[floor]
        x, y = (float(v) for v in np.asarray(p_world, dtype=np.float64)[:2])
        allowed = np.bincount(f.component.ravel()) * f.grid.resolution_m**2 >= min_area_m2
        allowed[0] = False
        if component is not None:
            allowed &= np.arange(len(allowed)) == component
        here = self._component_at((x, y), floor)
        if here and allowed[here]:
            return x, y, f.z_m
        cells = np.argwhere(allowed[f.component])
        if len(cells) == 0:
            return None
        centres = f.grid.centres_of(cells)
        away = np.hypot(centres[:, 0] - x, centres[:, 1] - y)
        nearest = int(np.argmin(away))
        if away[nearest] > within_m:
            return None
        return float(centres[nearest, 0]), float(centres[nearest, 1]), f.z_m

    def random_point(self, rng: np.random.Generator, floor: str) -> tuple[float, float, float]:
        """A place (x, y, z) [m] where robots live, every cell of the floor as likely as the next.

        Raises:
            BuildingError: robots can't get to this floor.
        """
        f = self.floors[floor]
        cells = np.argwhere(self.robot_area[floor])
        if len(cells) == 0:
            reachable = [name for name, area in self.robot_area.items() if area.any()]
            raise BuildingError(f"robots can't get to floor {floor!r}; they live on {reachable}")
        x, y = f.grid.centres_of(cells[rng.integers(len(cells))])
        return float(x), float(y), f.z_m

    def area_m2(self, floor: str) -> float:
        """Area of the floor indoors [m2], furnished or not; ``floors[floor].free_area_m2`` is what robots can use."""
        return self.floors[floor].floor_area_m2

    def way_free(self, p_from: ArrayLike, p_to: ArrayLike, floor: str) -> float:
        """How far one gets straight from one point to another before contact: share of the way, 1.0 for all of it."""
        f = self.floors[floor]
        scale = 1.0 / f.grid.resolution_m
        x0, y0 = np.asarray(p_from, dtype=np.float64)[:2]
        x1, y1 = np.asarray(p_to, dtype=np.float64)[:2]
        share = first_blocked(
            f.free, (y0 - f.grid.origin_y_m) * scale, (x0 - f.grid.origin_x_m) * scale,
            (y1 - f.grid.origin_y_m) * scale, (x1 - f.grid.origin_x_m) * scale,
        )  # fmt: skip
        return min(1.0, float(share))

    # ---- distances ---------------------------------------------------------------------------------------------

    def distance_field(self, goals: Mapping[str, ArrayLike]) -> DistanceField:
        """Distances from everywhere to the nearest goal, over stairs too (30-100 ms per floor).

        Args:
            goals: by floor, points (n, 2 or 3) [m]; those in cells that aren't free are ignored, the others count
                as the centres of their cells.
        """
        seeds: dict[str, dict[int, tuple[float, int]]] = {name: {} for name in self.floors}
        for name, points in goals.items():
            grid = self.floors[name].grid
            p = np.asarray(points, dtype=np.float64)
            if p.size == 0:
                continue
            cells = grid.cells_of(p.reshape(-1, p.shape[-1]))
            for row, col in cells[grid.contains(cells)]:
                seeds[name][int(row) * grid.cols + int(col)] = (0.0, -1)
        distance: dict[str, NDArray[np.float64]] = {}
        parent: dict[str, NDArray[np.int32]] = {}
        for name, floor in self.floors.items():
            distance[name] = np.full(floor.free.size, np.inf)
            parent[name] = np.full(floor.free.size, UNREACHED, dtype=np.int32)
        pending = [name for name in self.floors if seeds[name]]
        while pending:  # a floor is done again when a stair brings something shorter: ends, since ways only shrink
            name = pending.pop(0)
            r = self.floors[name].grid.resolution_m
            flat = np.fromiter(seeds[name], dtype=np.int64)
            cost = np.array([d for d, _ in seeds[name].values()]) / r
            cells_away, parent[name] = spread(self.floors[name].free, flat, cost)
            distance[name] = cells_away * r
            for index, transit in enumerate(self.transits):
                if name not in (transit.lower_floor, transit.upper_floor):
                    continue
                other = transit.other_floor(name)
                here, there = self._flat(transit.end_on(name), name), self._flat(transit.end_on(other), other)
                d = float(distance[name][here]) + transit.length_m
                if d < min(distance[other][there], seeds[other].get(there, (math.inf, -1))[0]) - 1e-9:
                    seeds[other][there] = (d, index)
                    if other not in pending:
                        pending.append(other)
        stairs = {name: {cell: stair for cell, (_, stair) in seeds[name].items() if stair >= 0} for name in self.floors}
        shaped = {n: d.astype(np.float32).reshape(self.floors[n].grid.shape) for n, d in distance.items()}
        return DistanceField(self, shaped, parent, stairs)

    def _flat(self, p_world: ArrayLike, floor: str) -> int:
        grid = self.floors[floor].grid
        row, col = (int(v) for v in grid.cells_of(np.asarray(p_world, dtype=np.float64)[:2]))
        return row * grid.cols + col

    def geodesic_distance(self, p_world: ArrayLike, floor: str, goals: Mapping[str, ArrayLike]) -> float:
        """Length [m] of the shortest way from a point on a floor to the nearest goal; inf if there is none."""
        return self.distance_field(goals).at(p_world, floor)

    def shortest_path(self, p_world: ArrayLike, floor: str, goals: Mapping[str, ArrayLike]) -> list[Waypoint]:
        """The way itself, both ends included; empty if there is none."""
        return self.distance_field(goals).path_from(p_world, floor)


def _grid_of(scene: Scene, resolution_m: float) -> Grid:
    """One grid for all floors, one cell wider than the building, its corner on a multiple of the resolution."""
    if len(scene.vertices) == 0:
        raise BuildingError(f"the building {scene.name!r} has no geometry: nothing to stand on")
    low, high = scene.vertices[:, :2].min(axis=0), scene.vertices[:, :2].max(axis=0)
    col0, row0 = (math.floor(float(v) / resolution_m) - 1 for v in low)
    col1, row1 = (math.floor(float(v) / resolution_m) + 2 for v in high)
    rows, cols = row1 - row0, col1 - col0
    if rows > 65536 or cols > 65536 or rows * cols > _MAX_CELLS:
        raise BuildingError(
            f"the building {scene.name!r} is {cols * resolution_m:.0f} x {rows * resolution_m:.0f} m: too large for a "
            f"grid of {resolution_m} m cells (at most {_MAX_CELLS} cells). Is its unit metres?"
        )
    return Grid(col0 * resolution_m, row0 * resolution_m, resolution_m, rows, cols)


def _supported(caster: RayCaster, grid: Grid, z_m: float, max_step_m: float) -> NDArray[np.bool_]:
    """Where a ray down from ``max_step_m`` above the floor finds a surface at most ``max_step_m`` below it."""
    return _vertical(caster, grid, z_m + max_step_m, -1.0) <= 2 * max_step_m


def _roofed(caster: RayCaster, grid: Grid, z_m: float) -> NDArray[np.bool_]:
    """Where a ray up from ``z_m`` finds anything."""
    return np.isfinite(_vertical(caster, grid, z_m, 1.0))


def _vertical(caster: RayCaster, grid: Grid, z_m: float, up: float) -> NDArray[np.float32]:
    """Range (rows, cols) [m] of rays straight up (1) or down (-1) from the centres of all cells at ``z_m``."""
    rows, cols = np.indices(grid.shape)
    origins = np.empty((*grid.shape, 3), dtype=np.float32)
    origins[..., :2] = grid.centres_of(np.stack([rows, cols], axis=-1))
    origins[..., 2] = z_m
    directions = np.broadcast_to(np.array([0.0, 0.0, up], dtype=np.float32), origins.shape)
    return caster.cast(origins, directions).t


def _components(free: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Connected parts (over edges) numbered from 1, the largest first."""
    label, count = ndimage.label(free)
    size = np.bincount(label.ravel(), minlength=count + 1)[1:]
    order = np.zeros(count + 1, dtype=np.int32)
    order[1 + np.argsort(-size, kind="stable")] = np.arange(1, count + 1)
    return np.asarray(order[label])
