"""What the joint maps show around frontiers, as numbers: the input of the model (``model.py``)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.occupancy import ESTIMATED_OBSTACLE, OBSTACLE, PRIOR_OBSTACLE
from surveilnav.services.planner.core.goals.frontiers import Frontier
from surveilnav.services.planner.core.inputs import FloorMaps

#: Cells of the coarse map that is looked at: free, an obstacle, unknown.
FREE, OCCUPIED, UNKNOWN = 0, 1, 2
#: Their side, or the next multiple of the map's resolution.
_CELL_M = 0.2
#: A coarse cell is an obstacle if so much of it is, and else known if so much of it is.
_OCCUPIED_SHARE, _KNOWN_SHARE = 0.25, 0.5
_WITHIN_M = (1.5, 3.0, 6.0)
_N_RAYS, _RAY_M = 32, 10.0
#: Rays that turn off the way into the unknown by less than this lead into it.
_AHEAD_RAD = math.pi / 3
_REACH_M = 8.0
#: The chance of an object counts less by e for each of these distances.
_DECAYS_M = (2.0, 5.0)
#: An object stands beside free cells, at most so many cells off.
_BESIDE_CELLS = 4

GEOMETRY = (
    "travel_time_m",
    "distance_m",
    "width_m",
    "travel_time_ratio",
    "n_frontiers",
    "explored_m2",
    *(f"{kind}_within_{r:g}_m" for kind in ("unknown", "free") for r in _WITHIN_M),
    *(f"occupied_within_{r:g}_m" for r in _WITHIN_M[:2]),
    "unknown_ahead_mean_m",
    "unknown_ahead_max_m",
    "unknown_mean_m",
    "free_behind_max_m",
    "free_mean_m",
    "clearance_m",
    "to_edge_m",
    "reached_m2",
    "rank",
)
#: For each class of objects: how likely one is near, by distance, and how many are near, by the way through free space.
OBJECTS = ("near_2_m", "near_5_m", "through")


def names(labels: Sequence[str], targets: Sequence[str]) -> list[str]:
    """The names of the columns of ``of_target``."""
    of_objects = [f"{kind} {label}" for kind in OBJECTS for label in labels]
    return [*GEOMETRY, *of_objects, *(f"{kind} target" for kind in OBJECTS), "target chance", *targets]


def of_target(
    features: NDArray[np.float32], labels: Sequence[str], targets: Sequence[str], target: str, chance: float
) -> NDArray[np.float32]:
    """(n, k) float32: the features of frontiers (``FrontierFeatures.of``) with those that depend on what is searched.

    Args:
        target: one of ``targets``. ``chance``: of the likeliest object on the floor to be one.
    """
    n = len(features)
    of_objects = features[:, len(GEOMETRY) :].reshape(n, len(OBJECTS), len(labels))
    one_hot = np.array([[label == target for label in targets]], np.float32).repeat(n, axis=0)
    own = of_objects[:, :, list(labels).index(target)]
    return np.concatenate([features, own, np.full((n, 1), chance, np.float32), one_hot], axis=1)


class FrontierFeatures:
    """The features of frontiers of one floor at one moment, for any target."""

    def __init__(self, maps: FloorMaps, robot_xy_m: tuple[float, float], labels: Sequence[str]) -> None:
        """``labels``: the classes of objects that are looked at."""
        self._grid, self._robot_xy_m = maps.grid, robot_xy_m
        self._cells = coarse_cells(maps)
        self._cell_m = cells_across(maps.grid.resolution_m) * maps.grid.resolution_m
        kept = [o for o in maps.objects if o.status != "rejected"]
        self._places = np.array([o.center_m[:2] for o in kept]).reshape(-1, 2)
        self._chances = np.array([[o.label_scores.get(label, 0.0) for label in labels] for o in kept])
        self._n_labels = len(labels)
        free_of_obstacles = (self._cells != OCCUPIED).astype(np.uint8)
        self._clearance_m = cv2.distanceTransform(free_of_obstacles, cv2.DIST_L2, 5) * self._cell_m
        known = np.argwhere(self._cells != UNKNOWN)
        ends = known if len(known) else np.zeros((1, 2), np.int64)
        self._low, self._high = ends.min(axis=0), ends.max(axis=0)
        self._explored_m2 = float((self._cells == FREE).sum()) * self._cell_m**2

    def of(self, frontiers: Sequence[Frontier]) -> NDArray[np.float32]:
        """(n, len(GEOMETRY) + len(OBJECTS) * number of labels) float32: those of n frontiers that are compared."""
        if not frontiers:
            return np.zeros((0, len(GEOMETRY) + len(OBJECTS) * self._n_labels), np.float32)
        travel_m = np.array([f.travel_time_m for f in frontiers])
        ranks = np.argsort(np.argsort(travel_m))
        rows = [
            self._row(f, float(travel_m.min()), len(frontiers), int(r)) for f, r in zip(frontiers, ranks, strict=True)
        ]
        return np.array(rows, np.float32)

    def _row(self, f: Frontier, nearest_m: float, n: int, rank: int) -> list[float]:
        row, col = self._cell_at(f.x_m, f.y_m)
        shares = [self._shares(row, col, r) for r in _WITHIN_M]
        rays_m = _rays(self._cells, row, col, _N_RAYS, round(_RAY_M / self._cell_m)) * self._cell_m
        unknown_m, free_m = rays_m[:, 0], rays_m[:, 1]
        turn_rad = np.arange(_N_RAYS) * (2 * math.pi / _N_RAYS) - self._outward_rad(row, col)
        ahead = np.cos(turn_rad) > math.cos(_AHEAD_RAD)
        reach_m = _ways(self._cells, row, col, round(_REACH_M / self._cell_m)) * self._cell_m
        to_edge = min(row - self._low[0], self._high[0] - row, col - self._low[1], self._high[1] - col)
        return [
            f.travel_time_m,
            math.dist((f.x_m, f.y_m), self._robot_xy_m),
            f.n_cells * self._grid.resolution_m,
            f.travel_time_m / max(0.5, nearest_m),
            n,
            self._explored_m2,
            *(s[UNKNOWN] for s in shares),
            *(s[FREE] for s in shares),
            *(s[OCCUPIED] for s in shares[:2]),
            float(unknown_m[ahead].mean()),
            float(unknown_m[ahead].max()),
            float(unknown_m.mean()),
            float(free_m[~ahead].max()),
            float(free_m.mean()),
            float(self._clearance_m[row, col]),
            float(to_edge) * self._cell_m,
            float(np.isfinite(reach_m).sum()) * self._cell_m**2,
            rank,
            *self._objects(f, row, col, reach_m),
        ]

    def _cell_at(self, x_m: float, y_m: float) -> tuple[int, int]:
        """The coarse cell at a place, the nearest one of the map if it lies outside."""
        rows, cols = self._cells.shape
        row, col = (
            int((y_m - self._grid.origin_y_m) // self._cell_m),
            int((x_m - self._grid.origin_x_m) // self._cell_m),
        )
        return min(rows - 1, max(0, row)), min(cols - 1, max(0, col))

    def _shares(self, row: int, col: int, radius_m: float) -> list[float]:
        """The shares of free, occupied and unknown cells in a square; all is unknown beyond the map."""
        k = round(radius_m / self._cell_m)
        window = self._cells[max(0, row - k) : row + k + 1, max(0, col - k) : col + k + 1]
        counts = np.bincount(window.ravel(), minlength=3)
        n = (2 * k + 1) ** 2
        counts[UNKNOWN] += n - window.size
        return (counts / n).tolist()  # type: ignore[no-any-return]

    def _outward_rad(self, row: int, col: int) -> float:
        """The direction from what is free near a cell to what is unknown near it."""
        k = round(1.0 / self._cell_m)
        window = self._cells[max(0, row - k) : row + k + 1, max(0, col - k) : col + k + 1]
        unknown, free = np.argwhere(window == UNKNOWN), np.argwhere(window == FREE)
        if not len(unknown) or not len(free):
            return 0.0
        towards = unknown.mean(axis=0) - free.mean(axis=0)
        return math.atan2(towards[0], towards[1])

    def _objects(self, f: Frontier, row: int, col: int, reach_m: NDArray[np.float32]) -> list[float]:
        if not len(self._places):
            return [0.0] * (len(OBJECTS) * self._n_labels)
        away_m = np.hypot(self._places[:, 0] - f.x_m, self._places[:, 1] - f.y_m)
        near = [(self._chances * np.exp(-away_m / decay_m)[:, None]).max(axis=0) for decay_m in _DECAYS_M]
        middle = reach_m.shape[0] // 2
        through_m = np.full(len(away_m), np.inf)
        for i in np.flatnonzero(away_m < _REACH_M):
            r, c = self._cell_at(*self._places[i])
            r, c = r - row + middle, c - col + middle
            k = _BESIDE_CELLS
            through_m[i] = reach_m[max(0, r - k) : r + k + 1, max(0, c - k) : c + k + 1].min(initial=np.inf)
        through = (self._chances * np.exp(-through_m / _DECAYS_M[-1])[:, None]).sum(axis=0)
        return [*near[0].tolist(), *near[1].tolist(), *through.tolist()]


def cells_across(resolution_m: float) -> int:
    """How many cells of the map lie along the side of a coarse one."""
    return max(1, round(_CELL_M / resolution_m))


def coarse_cells(maps: FloorMaps) -> NDArray[np.uint8]:
    """(rows, cols) uint8, FREE, OCCUPIED or UNKNOWN: the map in coarse cells."""
    k = cells_across(maps.grid.resolution_m)
    occupied = np.isin(maps.occupancy, (OBSTACLE, ESTIMATED_OBSTACLE, PRIOR_OBSTACLE))
    rows, cols = (n // k * k for n in occupied.shape)

    def share(layer: NDArray[np.bool_]) -> NDArray[np.float32]:
        whole = layer[:rows, :cols].astype(np.float32)
        return np.asarray(cv2.resize(whole, (cols // k, rows // k), interpolation=cv2.INTER_AREA), np.float32)

    is_known = share((maps.explored > 0) | occupied) >= _KNOWN_SHARE
    return np.where(share(occupied) >= _OCCUPIED_SHARE, OCCUPIED, np.where(is_known, FREE, UNKNOWN)).astype(np.uint8)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _rays(cells: Any, row: int, col: int, n: int, reach: int):  # type: ignore[no-untyped-def]
    """(n, 2): how many unknown and how many free cells a ray crosses before an obstacle; all is unknown beyond the map."""
    rows, cols = cells.shape
    crossed = np.zeros((n, 2))
    for i in range(n):
        d_row, d_col = math.sin(2 * math.pi * i / n), math.cos(2 * math.pi * i / n)
        for step in range(1, reach + 1):
            r, c = math.floor(row + d_row * step + 0.5), math.floor(col + d_col * step + 0.5)
            if r < 0 or c < 0 or r >= rows or c >= cols:
                crossed[i, 0] += reach - step + 1
                break
            if cells[r, c] == 1:  # OCCUPIED; the frontier itself may touch an obstacle
                if step > 1:
                    break
            elif cells[r, c] == 2:  # UNKNOWN
                crossed[i, 0] += 1
            else:
                crossed[i, 1] += 1
    return crossed


@njit(cache=True)  # type: ignore[untyped-decorator]
def _ways(cells: Any, row: int, col: int, limit: int):  # type: ignore[no-untyped-def]
    """(2 * limit + 1, the same) float32: ways through free cells from the one in the middle [cells]; inf beyond ``limit``."""
    side = 2 * limit + 1
    away = np.full((side, side), np.inf, np.float32)
    away[limit, limit] = 0.0
    queue = np.empty((8 * side * side, 2), np.int32)
    queue[0, 0], queue[0, 1] = limit, limit
    head, tail = 0, 1
    while head < tail and tail < len(queue) - 8:
        r, c = queue[head, 0], queue[head, 1]
        head += 1
        for d_row in range(-1, 2):
            for d_col in range(-1, 2):
                a, b = r + d_row, c + d_col
                if (d_row == 0 and d_col == 0) or a < 0 or b < 0 or a >= side or b >= side:
                    continue
                in_row, in_col = a - limit + row, b - limit + col
                if in_row < 0 or in_col < 0 or in_row >= cells.shape[0] or in_col >= cells.shape[1]:
                    continue
                way = away[r, c] + (1.0 if d_row == 0 or d_col == 0 else 1.4142135)
                if cells[in_row, in_col] == 0 and way < away[a, b] - 1e-4 and way <= limit:
                    away[a, b] = way
                    queue[tail, 0], queue[tail, 1] = a, b
                    tail += 1
    return away
