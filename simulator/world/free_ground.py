"""Where a robot can stand on each floor: cells that carry it and that nothing reaches into.

A cell carries a robot if a floor surface lies there (a ray down from just above it finds one) and nothing reaches into the
space that the robot needs above it (all triangles between ``max_step_m`` and ``robot_height_m``, glass included). What is
left is eroded by the robot's radius as Recast does for Habitat, and falls into connected components.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from surveilnav.errors import BuildingError
from surveilnav.geometry import Grid
from surveilnav.robot_body import clearance_m, fits
from surveilnav.simulator.world.geodesic import occupied_cells
from surveilnav.simulator.world.raycast import RayCaster
from surveilnav.simulator.world.scene import Floor, Scene

_MAX_CELLS = 64_000_000
#: With less than this share of the free cells under a roof, the building has none.
_ROOFED = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class FloorNavigation:
    """One floor. All arrays have the shape of ``grid``.

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


def find_free_ground(
    scene: Scene, caster: RayCaster, *, radius_m: float, resolution_m: float, robot_height_m: float, max_step_m: float
) -> dict[str, FloorNavigation]:
    """The free ground of every floor, by the floor's id.

    Raises:
        BuildingError: the building is too large for one grid.
    """
    grid = _grid_of(scene, resolution_m)
    floors = {
        floor.id: _ground_of(scene, caster, floor, grid, radius_m, robot_height_m, max_step_m) for floor in scene.floors
    }
    # A model without ceilings (a scan, a doll's house): tops of walls and cupboards are no roof.
    if sum((f.free & f.indoor).sum() for f in floors.values()) < _ROOFED * sum(f.free.sum() for f in floors.values()):
        floors = {f.id: replace(f, indoor=f.supported) for f in floors.values()}
    return floors


def _ground_of(
    scene: Scene, caster: RayCaster, floor: Floor, grid: Grid, radius_m: float, robot_height_m: float, max_step_m: float
) -> FloorNavigation:
    supported = _supported(caster, grid, floor.z_m, max_step_m)
    z_m = floor.z_m
    obstacle = occupied_cells(grid, scene.vertices, scene.triangles, z_m + max_step_m, z_m + robot_height_m)
    blocked = np.pad(~supported | obstacle, 1, constant_values=True)
    free = fits(clearance_m(blocked, grid.resolution_m), radius_m)[1:-1, 1:-1]
    indoor = supported & _roofed(caster, grid, floor.z_m + robot_height_m)
    return FloorNavigation(floor.id, floor.z_m, grid, free, components_of(free), supported, indoor, obstacle)


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
            f"grid of {resolution_m} m cells (at most {_MAX_CELLS} cells). {_farthest(scene)} Is its unit metres?"
        )
    return Grid(col0 * resolution_m, row0 * resolution_m, resolution_m, rows, cols)


def _farthest(scene: Scene) -> str:
    """Which piece of a building reaches farthest from the middle of all its corners, in a sentence for people."""
    if not scene.instances:
        return ""
    middle = np.median(scene.vertices[:, :2], axis=0)
    boxes = np.array([(i.p_min[:2], i.p_max[:2]) for i in scene.instances])
    reach_m = np.hypot(*np.abs(boxes - middle).max(axis=1).T)
    worst = int(reach_m.argmax())
    low, high = boxes[worst]
    name, where = scene.instances[worst].name[:40], f"({low[0]:.0f}, {low[1]:.0f}) to ({high[0]:.0f}, {high[1]:.0f}) m"
    return f"Farthest from its middle is {name!r}, from {where}: {reach_m[worst]:,.0f} m."


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


def components_of(free: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Connected parts (over edges) numbered from 1, the largest first."""
    label, count = ndimage.label(free)
    size = np.bincount(label.ravel(), minlength=count + 1)[1:]
    order = np.zeros(count + 1, dtype=np.int32)
    order[1 + np.argsort(-size, kind="stable")] = np.arange(1, count + 1)
    return np.asarray(order[label])
