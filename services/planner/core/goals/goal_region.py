"""Where to stand to have reached an object: the goal region that the planner drives to."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.motion.terrain import Terrain, clear_lines
from surveilnav.services.planner.core.state import RobotView

#: Higher than this above the floor an object stands on something, which reaches at most so far from it.
_RAISED_M = 0.3
_FURNITURE_M = 0.9
#: Seen from one side only: the mean direction is at least so long (1: all from one direction).
_ONE_SIDE = 0.5
#: The farthest ring before an object that counts as before it, and how much longer a way may be that leads nearer.
_RING_M = 0.95
_NEARER_M = 0.75
#: What lies lower above the floor is the floor, if at least so much of an object is higher.
_FLOOR_M = 0.10
_MOST_OF = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class GoalRegion:
    """Where to stand to have reached an object.

    Attributes:
        goals: bool of the terrain's shape, cells to stand on: as near as a way leads that is no detour, the object in sight.
        distance_m: float32 of the terrain's shape, plan distance of every cell to the object's nearest point; inf where
            that is farther than anybody asks for.
        sight: bool of the terrain's shape: nothing known stands between the cell and the object
            (reachable cells within ``farthest_stop_m`` of it, and the robot's own within ``inspect_m``).
        nearest_m: distance of the ring that the goals lie on.
    """

    goals: NDArray[np.bool_]
    distance_m: NDArray[np.float32]
    sight: NDArray[np.bool_]
    nearest_m: float


def footprint(record: ObjectRecord, floor_z_m: float) -> NDArray[np.float64]:
    """Plan points (N, 2) [m, world] of an object, without the floor next to it, that masks take in, and without the
    outermost tenth: stray depth pixels reach far. ``floor_z_m``: altitude of the floor.

    An object without points has the corners and the centre of its box.
    """
    whole = len(record.points) // 12 * 12
    p_world = np.frombuffer(record.points[:whole], dtype=np.float32).reshape(-1, 3).astype(np.float64)
    p_world = p_world[np.isfinite(p_world).all(axis=1)]
    above = p_world[:, 2] > floor_z_m + _FLOOR_M
    points = p_world[above if np.count_nonzero(above) >= _MOST_OF * len(p_world) else slice(None), :2]
    if len(points) < 4:
        (x, y, _), (w, d, _) = record.center_m, record.size_m
        return np.array([(x + i * w / 2, y + j * d / 2) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    away = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    trimmed: NDArray[np.float64] = points[away <= np.quantile(away, 0.9)]
    return trimmed


def goal_region(
    terrain: Terrain,
    travel_time_m: NDArray[np.float64],
    record: ObjectRecord,
    robot: RobotView,
    config: PlannerConfig,
    floor_z_m: float = 0.0,
) -> GoalRegion | None:
    """Where to stand before an object; None if no way leads within ``farthest_stop_m`` of it.

    Rings are tried from near to far, one farther off only if the way there is clearly shorter. ``travel_time_m``: from the
    robot (the terrain's shape); ``floor_z_m``: altitude of the floor.
    """
    around = _Around.of(terrain, record, config, floor_z_m)
    if around is None:
        return None
    part, distance_m, way_m = around.part, around.distance_m, travel_time_m[around.part.window]
    reachable = np.isfinite(way_m)
    near = reachable & (distance_m <= config.farthest_stop_m)
    if (here := part.cell(terrain.cell(robot.x_m, robot.y_m))) is not None:
        near[here] = distance_m[here] <= config.inspect_m
    sight, over, first = _sights(around, record, near, floor_z_m)
    for tries_m, ground in _grounds(part, sight, over, first, config):
        places = [(ring_m, ground & reachable & (distance_m <= ring_m)) for ring_m in tries_m]
        ways_m = [float(way_m[goals].min(initial=math.inf)) for _, goals in places]
        for (ring_m, goals), least_m in zip(places, ways_m, strict=True):
            if math.isfinite(least_m) and least_m <= ways_m[-1] + _NEARER_M:
                whole_m = part.whole(distance_m, np.float32(np.inf))
                return GoalRegion(part.whole(goals, False), whole_m, part.whole(over, False), ring_m)
    return None


def _sights(
    around: _Around, record: ObjectRecord, near: NDArray[np.bool_], floor_z_m: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
    """From which cells near an object it is in sight (each of the part's shape): with nothing in between, also over the
    furniture that it stands on, and which of both comes first: over it where the object was seen from one side only."""
    sight = _sight(around, near)
    if record.center_m[2] - record.size_m[2] / 2 - floor_z_m < _RAISED_M:
        return sight, sight, sight
    # a wall isn't furniture: what hangs on its other side is seen from there only
    one_side = math.hypot(*record.seen_from) >= _ONE_SIDE
    before = near & _on_the_side_seen(around.part, record) if one_side else near
    over = sight | _sight(around, before, _FURNITURE_M)
    return sight, over, over if one_side else sight


def _grounds(
    part: _Part, sight: NDArray[np.bool_], over: NDArray[np.bool_], first: NDArray[np.bool_], config: PlannerConfig
) -> tuple[tuple[tuple[float, ...], NDArray[np.bool_]], ...]:
    """Rings [m] and cells to stand on, best first: known ground in sight of the object, then ground from which only the
    furniture that it stands on is in between, unknown ground while the place hasn't been seen, then the same in places that
    are too tight by the map, by a cell first (maps are thicker than walls by as much), at last known ground without sight
    (a low shelf in between hides nothing from a camera above it)."""
    known, clearance_m = part.terrain.known[part.window], part.terrain.clearance_m[part.window]
    a_cell_m = part.terrain.grid.resolution_m
    roomy, nearly = (clearance_m >= config.robot_radius_m - short_m for short_m in (0.0, a_cell_m))
    rings_m = config.standoff_m, config.stop_m, _RING_M
    return (
        (rings_m, first & known & roomy),
        (rings_m, over & known & roomy),
        ((_RING_M,), sight & roomy),
        (rings_m, sight & known & nearly),
        (rings_m, over & known & nearly),
        (rings_m, sight & known),
        ((_RING_M,), sight),
        ((config.farthest_stop_m,), over & known),
        ((1.0,), known & roomy),
        ((1.0,), known),
    )


class _Part(NamedTuple):
    """A window of a terrain; ``row0``, ``col0``: its corner in it."""

    terrain: Terrain
    row0: int
    col0: int
    shape: tuple[int, int]

    @classmethod
    def around(cls, terrain: Terrain, cells: NDArray[np.int64], margin_m: float) -> _Part:
        """All within ``margin_m`` of cells (n, 2), and a little more."""
        margin = math.ceil(margin_m / terrain.grid.resolution_m) + 2
        low = np.maximum(cells.min(axis=0) - margin, 0)
        high = np.minimum(cells.max(axis=0) + margin + 1, terrain.grid.shape)
        return cls(terrain, int(low[0]), int(low[1]), (int(high[0] - low[0]), int(high[1] - low[1])))

    @property
    def window(self) -> tuple[slice, slice]:
        """What to take of an array of the terrain's shape."""
        return slice(self.row0, self.row0 + self.shape[0]), slice(self.col0, self.col0 + self.shape[1])

    def cell(self, cell: tuple[int, int]) -> tuple[int, int] | None:
        """A cell of the terrain in this window; None: it lies outside."""
        row, col = cell[0] - self.row0, cell[1] - self.col0
        return (row, col) if 0 <= row < self.shape[0] and 0 <= col < self.shape[1] else None

    def whole(self, values: NDArray[Any], outside: Any) -> NDArray[Any]:
        """An array of the terrain's shape."""
        array = np.full(self.terrain.grid.shape, outside, dtype=values.dtype)
        array[self.window] = values
        return array


@dataclass(frozen=True, slots=True, eq=False)
class _Around:
    """An object's surroundings: ``points`` (N, 2) [m, world] of it, ``mask`` 0 in its cells, ``distance_m`` to them and the
    label of the ``nearest`` one, as OpenCV numbers them; arrays of the part's shape."""

    part: _Part
    points: NDArray[np.float64]
    mask: NDArray[np.uint8]
    distance_m: NDArray[np.float32]
    nearest: NDArray[np.int32]

    @classmethod
    def of(cls, terrain: Terrain, record: ObjectRecord, config: PlannerConfig, floor_z_m: float) -> _Around | None:
        """None: the object lies outside of the terrain."""
        points = footprint(record, floor_z_m)
        cells = terrain.grid.cells_of(points)
        cells = cells[terrain.grid.contains(cells)]
        if not len(cells):
            return None
        near_m = max(config.farthest_stop_m, config.inspect_m, config.standoff_m, config.stop_m, 1.0)
        part = _Part.around(terrain, cells, near_m)
        mask = np.ones(part.shape, dtype=np.uint8)
        mask[cells[:, 0] - part.row0, cells[:, 1] - part.col0] = 0
        distance, nearest = cv2.distanceTransformWithLabels(mask, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
        return cls(part, points, mask, (distance * terrain.grid.resolution_m).astype(np.float32), nearest)


def _on_the_side_seen(part: _Part, record: ObjectRecord) -> NDArray[np.bool_]:
    """Cells (the part's shape) on the side of an object from which it was seen."""
    x, y = record.seen_from
    rows, cols = np.indices(part.shape, sparse=True)
    r, grid = part.terrain.grid.resolution_m, part.terrain.grid
    along_x = (grid.origin_x_m + (cols + part.col0 + 0.5) * r - record.center_m[0]) * x
    along_y = (grid.origin_y_m + (rows + part.row0 + 0.5) * r - record.center_m[1]) * y
    return np.asarray(along_x + along_y > 0.0)


def _sight(around: _Around, near: NDArray[np.bool_], furniture_m: float = 0.0) -> NDArray[np.bool_]:
    """For cells of the part in ``near``: whether the straight line to the object's nearest cell is free of obstacles, but
    for those next to the object that reach no farther than ``furniture_m``.

    Obstacles inside the object's own box (one cell wider) are the object itself.
    """
    part, nearest, points = around.part, around.nearest, around.points
    terrain, r = part.terrain, part.terrain.grid.resolution_m
    of_label = np.zeros((int(nearest.max()) + 1, 2), dtype=np.int64)
    zeros = np.argwhere(around.mask == 0)
    of_label[nearest[zeros[:, 0], zeros[:, 1]]] = zeros
    start = np.argwhere(near)
    end = of_label[nearest[start[:, 0], start[:, 1]]]

    obstacles = terrain.occupied[part.window].copy()
    row0, col0 = terrain.grid.cells_of(points.min(axis=0) - r) - (part.row0, part.col0)
    row1, col1 = terrain.grid.cells_of(points.max(axis=0) + r) - (part.row0, part.col0)
    obstacles[max(0, row0) : row1 + 1, max(0, col0) : col1 + 1] = False
    sight = np.zeros(part.shape, dtype=bool)
    sight[start[:, 0], start[:, 1]] = clear_lines(obstacles, start, end, furniture_m / r)
    return sight
