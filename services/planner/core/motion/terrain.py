"""Where the robot can drive and how fast: the speed map on which the Fast Marching Method runs.

Travel time is given in metres of comfortable free space: a metre near a wall or through unknown space counts as more.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from surveilnav.geometry import Grid
from surveilnav.occupancy import ESTIMATED_OBSTACLE, PRIOR_FREE
from surveilnav.robot_body import clearance_m, fits
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.inputs import FloorMaps, RobotView
from surveilnav.services.planner.core.memory.mission_state import MissionState
from surveilnav.services.planner.core.motion.areas import BarredCells, barred_cells, barring_area, cells_in, way_out
from surveilnav.services.planner.core.motion.fast_marching import fast_march

#: Travel time to a cell that no way leads to.
UNREACHED = np.inf


@dataclass(frozen=True, slots=True, eq=False)
class Terrain:
    """A window of the map around everything known, with the speed at which the robot can drive in every cell.

    Attributes:
        grid: frame of the window; all arrays are (rows, cols) of it. ``row0``, ``col0``: its first cell in the map.
        occupied: bool, obstacles that a sensor measured, or that a map from before has.
        known: bool, explored or known from before, and not occupied, also not by an obstacle that is only estimated.
        clearance_m: float32, distance to the nearest obstacle as mapped.
        speed: float64, 0 where the robot's centre can't be, else in (0, 1].
        bumps: (n, 3) float64 x, y [m], yaw [rad]: places and headings from which a move was cut short.
        revisit_m: float64, additional cost of a step that ends in a cell to which the robot came repeatedly of late.
        barred: where keepout zones and closed passages keep robots out; None: nowhere. ``speed`` is 0 there, unless the robot
            is there and has to get out.
        must_leave: the robot is inside such a place, and has to get out before anything else.
        speed_of_others: the speed for navigation that knows nothing of them, such as Nav2's.
    """

    grid: Grid
    row0: int
    col0: int
    occupied: NDArray[np.bool_]
    known: NDArray[np.bool_]
    clearance_m: NDArray[np.float32]
    speed: NDArray[np.float64]
    bumps: NDArray[np.float64]
    revisit_m: NDArray[np.float64]
    barred: BarredCells | None = None
    must_leave: bool = False
    speed_of_others: NDArray[np.float64] | None = None

    def crop(self, layer: NDArray) -> NDArray:
        """The window of a layer of the whole map, as a view."""
        return layer[self.row0 : self.row0 + self.grid.rows, self.col0 : self.col0 + self.grid.cols]

    def cell(self, x_m: float, y_m: float) -> tuple[int, int]:
        """(row, col) of the cell at a place; the nearest cell of the window if the place is outside."""
        row, col = self.grid.cells_of((x_m, y_m))
        return min(max(int(row), 0), self.grid.rows - 1), min(max(int(col), 0), self.grid.cols - 1)

    def centre_of(self, row: int, col: int) -> tuple[float, float]:
        """(x, y) [m, world] of a cell's centre."""
        x, y = self.grid.centres_of((row, col))
        return float(x), float(y)

    def disc(self, x_m: float, y_m: float, radius_m: float) -> NDArray[np.bool_]:
        """The cells within ``radius_m`` of a place (at least the cell there), bool of the window's shape."""
        mask = np.zeros(self.grid.shape, dtype=bool)
        mask[_cells_within(self.grid, [(x_m, y_m)], radius_m)] = True
        return mask

    def min_near(self, layer: NDArray[np.float64], x_m: float, y_m: float, radius_m: float) -> float:
        """The least value of a layer of the window's shape within ``radius_m`` of a place; inf if no cell is."""
        return float(layer[_cells_within(self.grid, [(x_m, y_m)], radius_m)].min(initial=math.inf))


def build_terrain(
    maps: FloorMaps,
    robot: RobotView,
    state: MissionState,
    config: PlannerConfig,
    places_m: Sequence[tuple[float, float]] = (),
) -> Terrain:
    """Crops the map to everything known and ``places_m``, plus a margin, and gives every cell its speed.

    Cells where the robot stands or stood are never blocked, so a robot that starts inside an inflated obstacle can leave it.
    """
    r = maps.grid.resolution_m
    row0, row1, col0, col1 = _known_window(maps, robot, places_m, config)
    window = slice(row0, row1), slice(col0, col1)
    grid = Grid(maps.grid.origin_x_m + col0 * r, maps.grid.origin_y_m + row0 * r, r, row1 - row0, col1 - col0)

    estimated = maps.occupancy[window] == ESTIMATED_OBSTACLE
    prior_free = maps.occupancy[window] == PRIOR_FREE  # nobody has looked there yet, but the way is known
    occupancy = ((maps.occupancy[window] != 0) & ~estimated & ~prior_free).astype(np.uint8)
    _paint(occupancy, grid, state.here.visited[-200:], 0.0, value=0)
    if any(area.kind == "open" for area in maps.areas):
        # What the map holds there is the door, from before it was opened.
        estimated |= (occupancy != 0) & (opened := cells_in(grid, maps.areas, "open"))
        occupancy[opened] = 0
    occupied, explored = occupancy != 0, (maps.explored[window] != 0) | prior_free
    clearance = clearance_m(occupied, r)
    speed = _speed(clearance, explored, config)
    if estimated.any():  # perhaps nothing is there: the robot drives around it if it can, and through it if it must
        speed[clearance_m(estimated, r) < config.robot_radius_m] *= config.estimated_obstacle_speed
    speed[_blocked(clearance, grid, robot, state, config) | occupied] = 0.0
    here = grid.cells_of((robot.x_m, robot.y_m))
    if grid.contains(here):
        speed[here[0], here[1]] = max(speed[here[0], here[1]], config.wall_speed)
    bumps = np.reshape(np.array(state.here.bumps, dtype=np.float64), (-1, 3))
    revisit = _revisit_m(grid, state.here.visited[-_RECENT_STEPS:], config)
    known = explored & ~occupied & ~estimated
    terrain = Terrain(grid, row0, col0, occupied, known, clearance, speed, bumps, revisit)
    barred = barred_cells(grid, maps.areas, config.robot_radius_m) if maps.areas else None
    if barred is None:
        return terrain
    stands_in = bool(barring_area(maps.areas, robot.x_m, robot.y_m))
    return _with_barred(terrain, barred, robot, config, stands_in=stands_in)


def _with_barred(
    terrain: Terrain, barred: BarredCells, robot: RobotView, config: PlannerConfig, *, stands_in: bool
) -> Terrain:
    """The terrain without the cells where no robot is sent.

    A robot that stands in an area, or whose body reaches into one, can leave it: slowly, so that the way out is short.
    """
    passable = np.zeros(terrain.grid.shape, dtype=bool)
    here = terrain.cell(robot.x_m, robot.y_m)
    row, col = here
    around = barred.inside[max(0, row - 1) : row + 2, max(0, col - 1) : col + 2]
    # A robot at the outermost cells just drives on: navigation cuts corners.
    must_leave = stands_in or bool(around.all())
    if must_leave:
        passable = way_out(barred, here)
    elif barred.near[here]:
        radius_m = config.robot_radius_m + config.robot_free_radius_m
        passable = terrain.disc(robot.x_m, robot.y_m, radius_m) & ~barred.inside
        passable[here] = True
    speed = np.where(barred.near, 0.0, terrain.speed)
    speed[passable & barred.near] = _WAY_OUT_SPEED * terrain.speed[passable & barred.near]
    return replace(terrain, speed=speed, barred=barred, must_leave=must_leave, speed_of_others=terrain.speed)


#: Factor on the speed of a robot that leaves an area where it shouldn't be.
_WAY_OUT_SPEED = 0.1


#: How many of the last steps count as recent, and how many arrivals at a cell among them are free.
_RECENT_STEPS = 60
_FREE_ARRIVALS = 2


def _revisit_m(grid: Grid, visited: Sequence[tuple[float, float]], config: PlannerConfig) -> NDArray[np.float64]:
    """The cost of revisiting, (rows, cols): it grows with the square of how often the robot came to a cell.

    A planner that looks only a few steps ahead can cycle between places each of which looks better from the one before.
    Raising the cost of visited cells breaks such cycles (node counting: Koenig & Szymanski 1999, "Value-update rules for
    real-time search").
    """
    cost = np.zeros(grid.shape)
    if len(visited) > _FREE_ARRIVALS:
        places = np.asarray(visited)
        came = np.append(True, np.any(np.abs(np.diff(places, axis=0)) > 1e-6, axis=1))
        cells, times = np.unique(grid.cells_of(places[came]), axis=0, return_counts=True)
        inside = grid.contains(cells)
        cells, more = cells[inside], np.maximum(times[inside] - _FREE_ARRIVALS, 0)
        cost[cells[:, 0], cells[:, 1]] = config.step_m * more**2
    return cost


def _speed(clearance: NDArray[np.float32], explored: NDArray[np.bool_], config: PlannerConfig) -> NDArray[np.float64]:
    """The speed in every cell by its clearance.

    It is ``constrained_speed`` within the robot's radius of an obstacle, and rises beyond that from ``wall_speed`` to 1 at
    ``comfort_clearance_m``. In unexplored space that is multiplied by ``unknown_speed``.
    """
    rise = (clearance - config.robot_radius_m) / (config.comfort_clearance_m - config.robot_radius_m)
    speed = (config.wall_speed + (1.0 - config.wall_speed) * np.clip(rise, 0.0, 1.0)).astype(np.float64)
    speed[~explored] *= config.unknown_speed
    speed[~fits(clearance, config.robot_radius_m)] = config.constrained_speed
    return np.asarray(speed)


def _blocked(
    clearance: NDArray[np.float32], grid: Grid, robot: RobotView, state: MissionState, config: PlannerConfig
) -> NDArray[np.bool_]:
    """Where the robot's centre can't be, (rows, cols) bool.

    That is where the robot doesn't fit even if mapped obstacles are too thick by ``obstacle_excess_m``, except where it stands
    or stood; and where it bumped into something. One cell around gaps that may be wide enough stays open for steering, because
    maps are often thicker on one side of a gap than on the other.
    """
    narrow = ~fits(clearance, config.robot_radius_m, config.obstacle_excess_m)
    blocked = cv2.erode(narrow.astype(np.uint8), np.ones((3, 3), np.uint8))
    _paint(blocked, grid, state.here.visited, config.visited_free_radius_m, value=0)
    _paint(blocked, grid, [(robot.x_m, robot.y_m)], config.robot_free_radius_m, value=0)
    _paint(blocked, grid, state.here.collisions, 0.0)
    return np.asarray(blocked != 0)


def travel_time_m(
    speed: NDArray[np.float64],
    sources: NDArray[np.bool_],
    resolution_m: float,
    stops: Sequence[ArrayLike] = (),
    margin_m: float = np.inf,
) -> NDArray[np.float64]:
    """Travel time [m of free space] from the nearest source to every cell: |grad T| = 1 / speed.

    Args:
        speed: (rows, cols), 0 where nothing passes.
        sources: (rows, cols) bool; blocked ones don't count.
        stops: places, each as the (row, col) of its cells (n, 2); at most 16. Cells farther than the nearest of each by more than
            ``margin_m`` aren't computed.

    Returns:
        (rows, cols) float64, ``UNREACHED`` (inf) where no way leads or nothing was computed.
    """
    return fast_march(speed, sources, stops, margin_m / resolution_m) * resolution_m


@njit(cache=True)  # type: ignore[untyped-decorator]
def lines_are_clear(obstacles, start, end, run):  # type: ignore[no-untyped-def]
    """Whether the straight lines between cells ``start`` (n, 2) and ``end`` (n, 2), int64, meet no obstacle: (n,) bool.

    ``obstacles``: (rows, cols) bool. A line is sampled once per cell along its longer side. The cells nearest to the end may be
    obstacles, up to the first that is free, over a length of at most ``run`` cells.
    """
    clear = np.ones(len(start), dtype=np.bool_)
    for i in range(len(start)):
        dr, dc = start[i, 0] - end[i, 0], start[i, 1] - end[i, 1]
        n = max(abs(dr), abs(dc), 1)
        per_step = math.sqrt(dr * dr + dc * dc) / n
        left = run
        for k in range(n + 1):
            if not obstacles[end[i, 0] + round(dr * k / n), end[i, 1] + round(dc * k / n)]:
                if left < run:  # the run has begun, and ends here
                    left = 0.0
                continue
            left -= per_step
            if left < 0.0:
                clear[i] = False
                break
    return clear


def coarse_travel_time_m(terrain: Terrain, x_m: float, y_m: float) -> NDArray[np.float64]:
    """Travel time from a place to every cell of the window where a robot may be sent, computed on cells of twice the size.

    Of four cells the fastest counts. Inflated obstacles are several cells thick, so this opens no wall.
    """
    rows, cols = terrain.grid.shape
    time = _coarse_march(_coarse_speed(terrain), terrain, x_m, y_m)
    fine = np.repeat(np.repeat(time, 2, axis=0), 2, axis=1)[:rows, :cols]
    fine[~_may_be_sent(terrain)] = UNREACHED
    return fine


def travel_times_between_m(
    terrain: Terrain, places_m: Sequence[tuple[float, float]], within_m: float
) -> NDArray[np.float64]:
    """(n, n) travel time [m] from each place (row) to within a distance of each other place, as ``coarse_travel_time_m`` says;
    ``UNREACHED`` where no way leads. At most 16 places."""
    speed, open_cells = _coarse_speed(terrain), _may_be_sent(terrain)
    near = []
    for place in places_m:
        rows, cols = _cells_within(terrain.grid, [place], within_m)
        is_open = open_cells[rows, cols]
        near.append(np.stack([rows[is_open], cols[is_open]], axis=1) // 2)
    times_m = np.full((len(places_m), len(places_m)), UNREACHED)
    for i, place in enumerate(places_m):
        others = [j for j, cells in enumerate(near) if j != i and len(cells)]
        time_m = _coarse_march(speed, terrain, *place, [near[j] for j in others])
        for j in others:
            times_m[i, j] = time_m[near[j][:, 0], near[j][:, 1]].min()
    np.fill_diagonal(times_m, 0.0)
    return times_m


def _coarse_speed(terrain: Terrain) -> NDArray[np.float64]:
    """The speed in cells of twice the size: of four cells the fastest counts."""
    rows, cols = terrain.grid.shape
    speed = np.pad(terrain.speed, ((0, rows % 2), (0, cols % 2)))
    return np.maximum(np.maximum(speed[::2, ::2], speed[1::2, ::2]), np.maximum(speed[::2, 1::2], speed[1::2, 1::2]))


def _coarse_march(
    speed: NDArray[np.float64], terrain: Terrain, x_m: float, y_m: float, stops: Sequence[ArrayLike] = ()
) -> NDArray[np.float64]:
    """Travel time [m] from a place to the cells of ``_coarse_speed``, until all ``stops`` are reached."""
    sources = np.zeros(speed.shape, dtype=bool)
    row, col = terrain.cell(x_m, y_m)
    sources[row // 2, col // 2] = True
    coarse_m = 2.0 * terrain.grid.resolution_m
    return travel_time_m(speed, sources, coarse_m, stops, coarse_m)  # cells that are as near are accepted in any order


def _may_be_sent(terrain: Terrain) -> NDArray[np.bool_]:
    """Where a robot may be sent: not where it may only pass to get out of a barred area."""
    passable = terrain.speed > 0.0
    return passable if terrain.barred is None else passable & ~terrain.barred.near


def _known_window(
    maps: FloorMaps, robot: RobotView, places_m: Sequence[tuple[float, float]], config: PlannerConfig
) -> tuple[int, int, int, int]:
    """(row0, row1, col0, col1), ends excluded, of a window around everything known, the robot and the places, with a margin."""
    known = (maps.explored != 0) | (maps.occupancy != 0)
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    cells = maps.grid.cells_of([(robot.x_m, robot.y_m), *places_m])
    cells = np.clip(cells, 0, (maps.grid.rows - 1, maps.grid.cols - 1))
    rows, cols = np.append(rows, cells[:, 0]), np.append(cols, cells[:, 1])
    margin = round(config.crop_margin_m / maps.grid.resolution_m)
    return (
        max(0, int(rows.min()) - margin),
        min(maps.grid.rows, int(rows.max()) + margin + 1),
        max(0, int(cols.min()) - margin),
        min(maps.grid.cols, int(cols.max()) + margin + 1),
    )


def _paint(
    mask: NDArray[np.uint8], grid: Grid, places_m: Sequence[tuple[float, float]], radius_m: float, value: int = 1
) -> None:
    """Sets all cells within ``radius_m`` of the places (at least the cell that each lies in) to ``value``."""
    if places_m:
        mask[_cells_within(grid, places_m, radius_m)] = value


def _cells_within(
    grid: Grid, places_m: Sequence[tuple[float, float]], radius_m: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the cells within ``radius_m`` of the places (at least the cell that each lies in); some repeat."""
    near = _disc_offsets(radius_m / grid.resolution_m)
    cells = (grid.cells_of(np.asarray(places_m))[:, None, :] + near[None, :, :]).reshape(-1, 2)
    cells = cells[grid.contains(cells)]
    return cells[:, 0], cells[:, 1]


@lru_cache(maxsize=64)
def _disc_offsets(radius: float) -> NDArray[np.int64]:
    """(n, 2): offsets (row, col) of the cells within ``radius`` cells of a cell."""
    half = int(radius)
    if half == 0:
        return np.zeros((1, 2), dtype=np.int64)
    offsets = np.arange(-half, half + 1)
    return np.argwhere(offsets[:, None] ** 2 + offsets[None, :] ** 2 <= radius * radius + 1e-9) - half
