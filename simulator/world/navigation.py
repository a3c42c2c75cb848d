"""Where a robot can stand and how far it is from there to anywhere: the simulator's navigation mesh.

Per floor, cells of 5 cm, free or not (``free_ground``). Stairs are transits between floors with a length of their own.

Only simulator, camera placement, the success check and the planner ``sp`` may use this: it is ground truth.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surveilnav.errors import BuildingError
from surveilnav.geometry import Grid
from surveilnav.robot_body import CLIMB_M, HEIGHT_M, RADIUS_M
from surveilnav.simulator.world.distance_field import DistanceField, Transit, distance_field
from surveilnav.simulator.world.free_ground import FloorNavigation, components_of, find_free_ground
from surveilnav.simulator.world.geodesic import first_blocked
from surveilnav.simulator.world.raycast import RayCaster
from surveilnav.simulator.world.scene import Scene, Stair
from surveilnav.storage import atomic_write

#: Raised by one with every change of what is computed: old caches are then built anew.
_FORMAT = 2


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
        robot_height_m: float = HEIGHT_M,
        max_step_m: float = CLIMB_M,
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
        floors = find_free_ground(
            scene,
            caster,
            radius_m=radius_m,
            resolution_m=resolution_m,
            robot_height_m=robot_height_m,
            max_step_m=max_step_m,
        )
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
        with atomic_write(path) as file:
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
                    floor.id, floor.z_m, grid, free, components_of(free), supported, indoor, obstacle
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
        *,
        within_m: float = 1.0,
        min_area_m2: float = 0.0,
    ) -> tuple[float, float, float] | None:
        """The nearest navigable place (x, y, z) [m] within ``within_m``, or None.

        ``min_area_m2`` leaves out places that are just gaps between furniture: the connected ground must be this large.
        """
        f = self.floors[floor]
        x, y = (float(v) for v in np.asarray(p_world, dtype=np.float64)[:2])
        allowed = np.bincount(f.component.ravel()) * f.grid.resolution_m**2 >= min_area_m2
        allowed[0] = False
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

    def way_free(self, p_from: ArrayLike, p_to: ArrayLike, floor: str) -> float:
        """How far one gets straight from one point to another before contact: share of the way, 1.0 for all of it."""
        f = self.floors[floor]
        scale = 1.0 / f.grid.resolution_m
        x0, y0 = np.asarray(p_from, dtype=np.float64)[:2]
        x1, y1 = np.asarray(p_to, dtype=np.float64)[:2]
        share = first_blocked(
            f.free,
            (y0 - f.grid.origin_y_m) * scale,
            (x0 - f.grid.origin_x_m) * scale,
            (y1 - f.grid.origin_y_m) * scale,
            (x1 - f.grid.origin_x_m) * scale,
        )
        return min(1.0, float(share))

    # ---- distances ---------------------------------------------------------------------------------------------

    def distance_field(self, goals: Mapping[str, ArrayLike]) -> DistanceField:
        """Computes the distance from every free cell to the nearest goal, along stairs too (30-100 ms per floor).

        Args:
            goals: by floor, points (n, 2) or (n, 3) [m, world]; a z is ignored, since the floor is named. A goal counts
                as the centre of its cell. Goals in cells that aren't free are ignored; if none is left, all distances
                are infinite.
        """
        return distance_field(self.floors, self.transits, goals)
