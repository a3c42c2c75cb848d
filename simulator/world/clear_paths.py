"""Ways over one floor that keep away from walls where there is room, as Nav2's costmaps make them.

The distances of ``geodesic`` are the shortest that there are, and their ways touch every corner. A robot that follows a way needs
room beside it. So cells near a wall cost more here; the way is a cheapest one over neighbouring cells (Dijkstra, by SciPy), and
pieces of it are replaced by straight lines that keep as far from walls as the piece did.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from surveilnav.robot_body import clearance_m
from surveilnav.simulator.world.free_ground import FloorNavigation
from surveilnav.simulator.world.geodesic import first_blocked

#: Room beside the robot's footprint [m]: with the last of these a cell costs no more than its length; the others are the steps by
#: which a straight line is compared with the way that it replaces.
_ROOM_M = (0.0, 0.05, 0.1, 0.2, 0.3)
#: A cell without any room costs this much more than its length.
_COST_WITHOUT_ROOM = 3.0
#: The search first looks this far for a goal, as a multiple of the straight line and in metres; then everywhere.
_DETOUR, _DETOUR_M = 1.6, 2.0
#: Straight lines are tried over at most this many cells of a way.
_MAX_SHORTCUT_CELLS = 200


class ClearPaths:
    """The ways of one floor. Made once; a way costs 10-50 ms in a home."""

    def __init__(self, ground: FloorNavigation) -> None:
        self._ground = ground

    def path(self, start_m: tuple[float, float], goal_m: tuple[float, float]) -> list[tuple[float, float]]:
        """Corners (x, y) [m] from a free place to another, both included; empty if no way leads there."""
        grid, component = self._ground.grid, self._ground.component
        ends = grid.cells_of((start_m, goal_m))
        if not grid.contains(ends).all():
            return []
        (start_row, start_col), (goal_row, goal_col) = ends
        if component[start_row, start_col] == 0 or component[start_row, start_col] != component[goal_row, goal_col]:
            return []
        cells = self._cells(int(start_row * grid.cols + start_col), int(goal_row * grid.cols + goal_col))
        rows, cols = np.divmod(np.array(cells), grid.cols)
        points = np.stack([rows, cols], axis=-1) + 0.5
        corner = np.array([grid.origin_y_m, grid.origin_x_m])
        points[0], points[-1] = ((np.array(p[::-1]) - corner) / grid.resolution_m for p in (start_m, goal_m))
        if len(points) == 1:
            points = np.stack([(np.array(p[::-1]) - corner) / grid.resolution_m for p in (start_m, goal_m)])
            rows, cols = np.repeat(rows, 2), np.repeat(cols, 2)
        kept = _straighten(self._room_steps, self._room_step_of_cell[rows, cols], points)
        corners = [(float(x), float(y)) for y, x in points[kept[1:-1]] * grid.resolution_m + corner]
        return [start_m, *corners, goal_m]

    def nearest(
        self, goal_m: tuple[float, float], reached_from_m: tuple[float, float], within_m: float
    ) -> tuple[float, float] | None:
        """The free place nearest to ``goal_m`` (itself, if it is free) that a way leads to; None if none is near enough."""
        grid, component = self._ground.grid, self._ground.component
        row, col = grid.cells_of(reached_from_m)
        wanted = component[row, col]
        goal_row, goal_col = (int(v) for v in grid.cells_of(goal_m))
        reach = math.ceil(within_m / grid.resolution_m)
        row0, col0 = max(0, goal_row - reach), max(0, goal_col - reach)
        window = component[row0 : max(0, goal_row + reach + 1), col0 : max(0, goal_col + reach + 1)]
        inside = grid.contains((goal_row, goal_col))
        if inside and component[goal_row, goal_col] == wanted:
            return goal_m
        cells = np.argwhere(window == wanted) + np.array((row0, col0))
        if len(cells) == 0:
            return None
        centres = grid.centres_of(cells)
        away_m = np.hypot(centres[:, 0] - goal_m[0], centres[:, 1] - goal_m[1])
        nearest = int(away_m.argmin())
        if away_m[nearest] > within_m:
            return None
        return float(centres[nearest, 0]), float(centres[nearest, 1])

    def _cells(self, start: int, goal: int) -> list[int]:
        """Flat indices of the cells of a cheapest way."""
        grid, number, cells = self._ground.grid, self._number_of_cell, self._free_cells
        (r0, c0), (r1, c1) = divmod(start, grid.cols), divmod(goal, grid.cols)
        straight_m = math.hypot(r1 - r0, c1 - c0) * grid.resolution_m
        for limit in (_DETOUR * straight_m + _DETOUR_M, math.inf):
            cost, before = dijkstra(self._graph, indices=int(number[start]), return_predecessors=True, limit=limit)
            if math.isfinite(cost[number[goal]]):
                break
        way = [int(number[goal])]
        while way[-1] != number[start]:
            way.append(int(before[way[-1]]))
        return [int(cells[node]) for node in reversed(way)]

    @cached_property
    def _room_m(self) -> NDArray[np.float32]:
        """(rows, cols) from the footprint of a robot there to the nearest obstacle, to half a cell; 0 where it can't stand."""
        free = np.pad(self._ground.free, 1)
        return clearance_m(~free, self._ground.grid.resolution_m)[1:-1, 1:-1]

    @cached_property
    def _room_steps(self) -> NDArray[np.bool_]:
        """(steps, rows, cols): where there is as much room as each of ``_ROOM_M``."""
        return np.stack([self._ground.free & (self._room_m > room_m) for room_m in _ROOM_M])

    @cached_property
    def _room_step_of_cell(self) -> NDArray[np.int64]:
        """(rows, cols): the last step that has the cell; -1: none."""
        return np.asarray(self._room_steps.sum(axis=0) - 1)

    @cached_property
    def _free_cells(self) -> NDArray[np.int64]:
        """Flat indices of the free cells, in the order of the graph's nodes."""
        return np.flatnonzero(self._ground.free)

    @cached_property
    def _number_of_cell(self) -> NDArray[np.int64]:
        """The node of each cell by flat index; -1 where it isn't free."""
        number = np.full(self._ground.free.size, -1)
        number[self._free_cells] = np.arange(len(self._free_cells))
        return number

    @cached_property
    def _graph(self) -> csr_array:
        """Between free cells and their eight neighbours, not past a blocked cell's corner."""
        free, rows, cols = self._ground.free, *self._ground.free.shape
        lack = 1.0 - np.minimum(self._room_m / _ROOM_M[-1], 1.0)
        cost = (1.0 + _COST_WITHOUT_ROOM * lack**2).ravel()
        number = self._number_of_cell.reshape(rows, cols)
        starts, ends, weights = [], [], []
        for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
            here = (slice(0, rows - down), slice(max(0, -right), cols - max(0, right)))
            there = (slice(down, rows), slice(max(0, right), cols - max(0, -right)))
            joined = free[here] & free[there]
            if down and right:
                joined &= free[here[0], there[1]] & free[there[0], here[1]]
            a, b = number[here][joined], number[there][joined]
            between = (cost[self._free_cells[a]] + cost[self._free_cells[b]]) / 2
            length_m = math.hypot(down, right) * self._ground.grid.resolution_m
            starts += [a, b]
            ends += [b, a]
            weights += [between * length_m] * 2
        n = len(self._free_cells)
        edges = (np.concatenate(weights), (np.concatenate(starts), np.concatenate(ends)))
        return csr_array(edges, shape=(n, n))


def _straighten(
    room_steps: NDArray[np.bool_], step_of_point: NDArray[np.int64], points: NDArray[np.float64]
) -> list[int]:
    """Which points of a way (n, 2) (row, col) remain when straight lines that have as much room replace the others."""
    kept, here, last = [0], 0, len(points) - 1
    while here < last:
        farthest, least = here + 1, step_of_point[here]
        for there in range(here + 1, min(last, here + _MAX_SHORTCUT_CELLS) + 1):
            least = min(least, step_of_point[there])
            r0, c0, r1, c1 = points[here, 0], points[here, 1], points[there, 0], points[there, 1]
            if first_blocked(room_steps[least], r0, c0, r1, c1) > 1.0:
                farthest = there
        kept.append(farthest)
        here = farthest
    return kept
