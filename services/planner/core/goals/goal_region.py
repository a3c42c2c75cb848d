"""The goal region of an object: where the robot has to stand to have reached it. The planner drives there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.inputs import RobotView
from surveilnav.services.planner.core.motion.terrain import Terrain, lines_are_clear

#: An object whose lower edge is higher than this above the floor stands on furniture, which is at most this wide around it.
_RAISED_M = 0.3
_FURNITURE_M = 0.9
#: An object was seen from one side if the mean of the directions to its views is at least this long (1: all were the same).
_ONE_SIDE = 0.5
#: The outermost distance at which the robot stands close to an object.
_CLOSE_M = 0.95
#: A smaller distance is preferred unless its way is longer by more than this.
_WORTH_DETOUR_M = 0.75
#: Points lower than this above the floor belong to the floor, if at least this share of an object's points is higher.
_FLOOR_M = 0.10
_ABOVE_FLOOR_SHARE = 0.5
#: Another place to look from lies in a direction from the object that differs by at least this from those tried.
_ELSEWHERE_RAD = math.radians(45)
#: Where no sight line is known, the robot has to stand this near.
_WITHOUT_SIGHT_M = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class GoalRegion:
    """Where to stand to have reached an object.

    Attributes:
        goals: bool of the terrain's shape, cells to stand on: as near to the object as a way without a detour leads, and in
            sight of it where possible.
        distance_m: float32 of the terrain's shape, distance on the floor from every cell to the object's nearest point; inf
            where it is farther than any setting asks for.
        sight: bool of the terrain's shape: nothing known stands between the cell and the object. Computed for reachable cells
            within ``farthest_stop_m`` of the object, and for the robot's own cell within ``inspect_m``.
        nearest_m: the goals are within this distance of the object.
    """

    goals: NDArray[np.bool_]
    distance_m: NDArray[np.float32]
    sight: NDArray[np.bool_]
    nearest_m: float


def goal_region(
    terrain: Terrain,
    travel_time_m: NDArray[np.float64],
    record: ObjectRecord,
    robot: RobotView,
    config: PlannerConfig,
    floor_z_m: float = 0.0,
    looked_from: Sequence[tuple[float, float]] = (),
) -> GoalRegion | None:
    """The goal region of an object; None if no way leads to within ``farthest_stop_m`` of it.

    Distances to the object are tried from near to far. A larger one is taken only if the way there is clearly shorter.

    Args:
        travel_time_m: from the robot (the terrain's shape). ``floor_z_m``: altitude of the floor.
        looked_from: places (x, y) [m] from which the robot looked at the object in vain. The region is elsewhere, and on the side
            from which the object was seen if it was seen from one side only.
    """
    around = _Surroundings.from_object(terrain, record, config, floor_z_m)
    if around is None:
        return None
    window, distance_m, time_m = around.window, around.distance_m, travel_time_m[around.window.slices]
    reachable = np.isfinite(time_m)
    if looked_from:
        reachable &= _elsewhere(window, record, looked_from)
    near = reachable & (distance_m <= config.farthest_stop_m)
    if (here := window.cell(terrain.cell(robot.x_m, robot.y_m))) is not None:
        near[here] = distance_m[here] <= config.inspect_m and (not looked_from or bool(reachable[here]))
    sight = _sight_lines(around, record, near, floor_z_m)
    # a new place to look from is wanted soon rather than as near as can be
    distances_m = (_CLOSE_M,) if looked_from else (config.standoff_m, config.stop_m, _CLOSE_M)
    for option in _ground_options(window, sight, config, distances_m):
        regions = [(d, option.ground & reachable & (distance_m <= d)) for d in option.distances_m]
        times_m = [float(time_m[goals].min(initial=math.inf)) for _, goals in regions]
        for (nearest_m, goals), least_m in zip(regions, times_m, strict=True):
            if math.isfinite(least_m) and least_m <= times_m[-1] + _WORTH_DETOUR_M:
                return GoalRegion(
                    window.expand(goals, False),
                    window.expand(distance_m, np.float32(np.inf)),
                    window.expand(sight.over_furniture, False),
                    nearest_m,
                )
    return None


def footprint(record: ObjectRecord, floor_z_m: float) -> NDArray[np.float64]:
    """Points (n, 2) [m, world] of an object, seen from above. ``floor_z_m``: altitude of the floor.

    Points of the floor, which masks include at an object's foot, are left out. So is the outermost tenth, because stray depth
    pixels reach far. An object without enough points is represented by the corners, the edges' middles and the centre of its
    box.
    """
    n_bytes = len(record.points) // 12 * 12
    p_world = np.frombuffer(record.points[:n_bytes], dtype=np.float32).reshape(-1, 3).astype(np.float64)
    p_world = p_world[np.isfinite(p_world).all(axis=1)]
    above = p_world[:, 2] > floor_z_m + _FLOOR_M
    keeps_above = np.count_nonzero(above) >= _ABOVE_FLOOR_SHARE * len(p_world)
    points = p_world[above if keeps_above else slice(None), :2]
    if len(points) < 4:
        (x, y, _), (w, d, _) = record.center_m, record.size_m
        return np.array([(x + i * w / 2, y + j * d / 2) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    distance = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    trimmed: NDArray[np.float64] = points[distance <= np.quantile(distance, 0.9)]
    return trimmed


class _Window(NamedTuple):
    """A window of a terrain, whose first cell is (``row0``, ``col0``)."""

    terrain: Terrain
    row0: int
    col0: int
    shape: tuple[int, int]

    @classmethod
    def around(cls, terrain: Terrain, cells: NDArray[np.int64], margin_m: float) -> _Window:
        """The window that holds everything within ``margin_m`` of cells (n, 2)."""
        margin = math.ceil(margin_m / terrain.grid.resolution_m) + 2
        low = np.maximum(cells.min(axis=0) - margin, 0)
        high = np.minimum(cells.max(axis=0) + margin + 1, terrain.grid.shape)
        return cls(terrain, int(low[0]), int(low[1]), (int(high[0] - low[0]), int(high[1] - low[1])))

    @property
    def slices(self) -> tuple[slice, slice]:
        """Index of this window in an array of the terrain's shape."""
        return slice(self.row0, self.row0 + self.shape[0]), slice(self.col0, self.col0 + self.shape[1])

    def cell(self, cell: tuple[int, int]) -> tuple[int, int] | None:
        """A cell of the terrain, in this window's rows and columns; None: it lies outside."""
        row, col = cell[0] - self.row0, cell[1] - self.col0
        return (row, col) if 0 <= row < self.shape[0] and 0 <= col < self.shape[1] else None

    def expand(self, values: NDArray[Any], outside: Any) -> NDArray[Any]:
        """An array of the terrain's shape with the values in this window and ``outside`` elsewhere."""
        array = np.full(self.terrain.grid.shape, outside, dtype=values.dtype)
        array[self.slices] = values
        return array


@dataclass(frozen=True, slots=True, eq=False)
class _Surroundings:
    """A window around an object. Arrays are of the window's shape.

    Attributes:
        points: (n, 2) [m, world] of the object.
        mask: uint8, 0 in the object's cells.
        distance_m: to the object's nearest cell; ``nearest_label``: OpenCV's label of that cell.
    """

    window: _Window
    points: NDArray[np.float64]
    mask: NDArray[np.uint8]
    distance_m: NDArray[np.float32]
    nearest_label: NDArray[np.int32]

    @classmethod
    def from_object(
        cls, terrain: Terrain, record: ObjectRecord, config: PlannerConfig, floor_z_m: float
    ) -> _Surroundings | None:
        """The surroundings of an object; None: it lies outside of the terrain."""
        points = footprint(record, floor_z_m)
        cells = terrain.grid.cells_of(points)
        cells = cells[terrain.grid.contains(cells)]
        if not len(cells):
            return None
        margin_m = max(config.farthest_stop_m, config.inspect_m, config.standoff_m, config.stop_m, _WITHOUT_SIGHT_M)
        window = _Window.around(terrain, cells, margin_m)
        mask = np.ones(window.shape, dtype=np.uint8)
        mask[cells[:, 0] - window.row0, cells[:, 1] - window.col0] = 0
        distance, label = cv2.distanceTransformWithLabels(mask, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
        return cls(window, points, mask, (distance * terrain.grid.resolution_m).astype(np.float32), label)


class _SightLines(NamedTuple):
    """From which cells an object is in sight, bool of the window's shape each.

    Attributes:
        direct: nothing stands in between.
        over_furniture: nothing but the furniture that the object stands on.
        preferred: which of both is tried first: over the furniture if the object was seen from one side only.
    """

    direct: NDArray[np.bool_]
    over_furniture: NDArray[np.bool_]
    preferred: NDArray[np.bool_]


def _sight_lines(around: _Surroundings, record: ObjectRecord, near: NDArray[np.bool_], floor_z_m: float) -> _SightLines:
    """From which of the cells ``near`` an object it is in sight."""
    direct = _in_sight(around, near)
    if record.center_m[2] - record.size_m[2] / 2 - floor_z_m < _RAISED_M:
        return _SightLines(direct, direct, direct)
    # a wall isn't furniture: what hangs on its other side can be seen from there only
    one_side = _was_seen_from_one_side(record)
    before = near & _on_the_side_seen(around.window, record) if one_side else near
    over_furniture = direct | _in_sight(around, before, _FURNITURE_M)
    return _SightLines(direct, over_furniture, over_furniture if one_side else direct)


class _GroundOption(NamedTuple):
    """Cells to stand on (bool of the window's shape), and the distances to the object [m] to try, from near to far."""

    distances_m: tuple[float, ...]
    ground: NDArray[np.bool_]


def _ground_options(
    window: _Window, sight: _SightLines, config: PlannerConfig, distances_m: tuple[float, ...]
) -> tuple[_GroundOption, ...]:
    """Where the robot may stand, best first. ``distances_m``: to the object, to try on ground that is known, from near to far.

    1. Known ground with sight of the object, where the robot fits.
    2. The same, with only the furniture in between that the object stands on.
    3. Unknown ground, as long as nobody has seen that place.
    4. The same where the robot doesn't fit by the map: first if it is too narrow by a cell, because maps are thicker than
       walls by about as much.
    5. Known ground without sight: a low shelf in between hides nothing from a camera above it.
    """
    known, clearance_m = window.terrain.known[window.slices], window.terrain.clearance_m[window.slices]
    fits = clearance_m >= config.robot_radius_m
    almost_fits = clearance_m >= config.robot_radius_m - window.terrain.grid.resolution_m
    return (
        _GroundOption(distances_m, sight.preferred & known & fits),
        _GroundOption(distances_m, sight.over_furniture & known & fits),
        _GroundOption((_CLOSE_M,), sight.direct & fits),
        _GroundOption(distances_m, sight.direct & known & almost_fits),
        _GroundOption(distances_m, sight.over_furniture & known & almost_fits),
        _GroundOption(distances_m, sight.direct & known),
        _GroundOption((_CLOSE_M,), sight.direct),
        _GroundOption((config.farthest_stop_m,), sight.over_furniture & known),
        _GroundOption((_WITHOUT_SIGHT_M,), known & fits),
        _GroundOption((_WITHOUT_SIGHT_M,), known),
    )


def _was_seen_from_one_side(record: ObjectRecord) -> bool:
    return math.hypot(*record.seen_from) >= _ONE_SIDE


def _elsewhere(window: _Window, record: ObjectRecord, looked_from: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    """The cells (bool of the window's shape) in other directions than those looked from in vain, on the side that was seen."""
    x_m, y_m = _offsets_m(window, record)
    bearing_rad = np.arctan2(y_m, x_m)
    there = _on_the_side_seen(window, record) if _was_seen_from_one_side(record) else np.ones(window.shape, dtype=bool)
    for at in looked_from:
        tried_rad = math.atan2(at[1] - record.center_m[1], at[0] - record.center_m[0])
        there &= np.cos(bearing_rad - tried_rad) <= math.cos(_ELSEWHERE_RAD)
    return there


def _on_the_side_seen(window: _Window, record: ObjectRecord) -> NDArray[np.bool_]:
    """The cells (bool of the window's shape) on the side of an object from which it was seen."""
    x_m, y_m = _offsets_m(window, record)
    return np.asarray(x_m * record.seen_from[0] + y_m * record.seen_from[1] > 0.0)


def _offsets_m(window: _Window, record: ObjectRecord) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """x (1, cols) and y (rows, 1) [m] of a window's cells from the object's centre."""
    rows, cols = np.indices(window.shape, sparse=True)
    r, grid = window.terrain.grid.resolution_m, window.terrain.grid
    x_m = grid.origin_x_m + (cols + window.col0 + 0.5) * r - record.center_m[0]
    return x_m, grid.origin_y_m + (rows + window.row0 + 0.5) * r - record.center_m[1]


def _in_sight(around: _Surroundings, near: NDArray[np.bool_], furniture_m: float = 0.0) -> NDArray[np.bool_]:
    """Which of the cells ``near`` (bool of the window's shape) have a clear straight line to the object's nearest cell.

    Obstacles inside the object's own box, enlarged by a cell, are the object itself. So are those next to it that reach no
    farther than ``furniture_m``: they are what it stands on.
    """
    window, points = around.window, around.points
    terrain, r = window.terrain, window.terrain.grid.resolution_m
    object_cells = np.argwhere(around.mask == 0)
    cell_of_label = np.zeros((int(around.nearest_label.max()) + 1, 2), dtype=np.int64)
    cell_of_label[around.nearest_label[object_cells[:, 0], object_cells[:, 1]]] = object_cells
    start = np.argwhere(near)
    end = cell_of_label[around.nearest_label[start[:, 0], start[:, 1]]]

    obstacles = terrain.occupied[window.slices].copy()
    row0, col0 = terrain.grid.cells_of(points.min(axis=0) - r) - (window.row0, window.col0)
    row1, col1 = terrain.grid.cells_of(points.max(axis=0) + r) - (window.row0, window.col0)
    obstacles[max(0, row0) : row1 + 1, max(0, col0) : col1 + 1] = False
    sight = np.zeros(window.shape, dtype=bool)
    sight[start[:, 0], start[:, 1]] = lines_are_clear(obstacles, start, end, furniture_m / r)
    return sight
