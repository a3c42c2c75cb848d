"""Shortest distances over a whole building, stairs included, and the ways that have these lengths."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surveilnav.geometry import Grid
from surveilnav.simulator.world.free_ground import FloorNavigation
from surveilnav.simulator.world.geodesic import UNREACHED, spread

#: By floor and cell: the distance [m] with which a cell starts, and the number of the stair that led to it (-1: a goal).
_Seeds = dict[str, dict[int, tuple[float, int]]]


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

    ``distance_m``: float32 of the floor's grid, by floor; inf where no goal can be reached.
    """

    floors: Mapping[str, FloorNavigation]
    transits: Sequence[Transit]
    distance_m: dict[str, NDArray[np.float32]]
    _parent: dict[str, NDArray[np.int32]]
    _stair_of_seed: dict[str, dict[int, int]]

    def at(self, p_world: ArrayLike, floor: str) -> float:
        """Distance [m] from a point (x, y[, z]) on a floor; inf if it isn't free or no goal can be reached."""
        grid = self.floors[floor].grid
        x, y = np.asarray(p_world, dtype=np.float64)[:2]
        if not grid.contains(grid.cells_of((x, y))):
            return math.inf
        parent = int(self._parent[floor][_flat(grid, (x, y))])
        if parent == UNREACHED:
            return math.inf
        corner = grid.centres_of(divmod(parent, grid.cols))
        return math.hypot(corner[0] - x, corner[1] - y) + float(self.distance_m[floor].ravel()[parent])

    def path_from(self, p_world: ArrayLike, floor: str) -> list[Waypoint]:
        """The shortest way to the nearest goal, both ends included; empty if there is none."""
        if math.isinf(self.at(p_world, floor)):
            return []
        x, y = (float(v) for v in np.asarray(p_world, dtype=np.float64)[:2])
        way = [Waypoint(floor, x, y)]
        cell = _flat(self.floors[floor].grid, (x, y))
        while True:
            grid = self.floors[floor].grid
            parent = int(self._parent[floor][cell])
            px, py = grid.centres_of(divmod(parent, grid.cols))
            if (px, py) != (way[-1].x_m, way[-1].y_m):
                way.append(Waypoint(floor, float(px), float(py)))
            if parent != cell:
                cell = parent
                continue
            if cell not in self._stair_of_seed[floor]:
                return way
            transit = self.transits[self._stair_of_seed[floor][cell]]
            floor = transit.other_floor(floor)
            end = transit.end_on(floor)
            cell = _flat(self.floors[floor].grid, end)
            way.append(Waypoint(floor, end[0], end[1]))


def distance_field(
    floors: Mapping[str, FloorNavigation], transits: Sequence[Transit], goals: Mapping[str, ArrayLike]
) -> DistanceField:
    """Distances to the nearest goal, see ``NavigationMap.distance_field``."""
    seeds = _seeds_at(floors, goals)
    distance = {name: np.full(f.free.size, np.inf) for name, f in floors.items()}
    parent = {name: np.full(f.free.size, UNREACHED, dtype=np.int32) for name, f in floors.items()}
    pending = [name for name in floors if seeds[name]]
    while pending:  # a floor is done again when a stair brings something shorter: ends, since ways only shrink
        name = pending.pop(0)
        free, resolution_m = floors[name].free, floors[name].grid.resolution_m
        cost_cells = np.array([d for d, _ in seeds[name].values()]) / resolution_m
        cells_away, parent[name] = spread(free, np.fromiter(seeds[name], dtype=np.int64), cost_cells)
        distance[name] = cells_away * resolution_m
        for other in _shorten_over_stairs(floors, transits, name, distance, seeds):
            if other not in pending:
                pending.append(other)
    stairs = {name: {cell: s for cell, (_, s) in seeds[name].items() if s >= 0} for name in floors}
    shaped = {n: d.astype(np.float32).reshape(floors[n].grid.shape) for n, d in distance.items()}
    return DistanceField(floors, transits, shaped, parent, stairs)


def _seeds_at(floors: Mapping[str, FloorNavigation], goals: Mapping[str, ArrayLike]) -> _Seeds:
    """The cells of the goals, at distance 0."""
    seeds: _Seeds = {name: {} for name in floors}
    for name, points in goals.items():
        grid = floors[name].grid
        p = np.asarray(points, dtype=np.float64)
        if p.size == 0:
            continue
        cells = grid.cells_of(p.reshape(-1, p.shape[-1]))
        for row, col in cells[grid.contains(cells)]:
            seeds[name][int(row) * grid.cols + int(col)] = (0.0, -1)
    return seeds


def _shorten_over_stairs(
    floors: Mapping[str, FloorNavigation],
    transits: Sequence[Transit],
    name: str,
    distance: Mapping[str, NDArray[np.float64]],
    seeds: _Seeds,
) -> list[str]:
    """Adds to ``seeds`` where a stair from floor ``name`` is shorter than what is known on the other floor; returns those
    other floors."""
    shortened = []
    for index, transit in enumerate(transits):
        if name not in (transit.lower_floor, transit.upper_floor):
            continue
        other = transit.other_floor(name)
        here = _flat(floors[name].grid, transit.end_on(name))
        there = _flat(floors[other].grid, transit.end_on(other))
        d = float(distance[name][here]) + transit.length_m
        if d < min(distance[other][there], seeds[other].get(there, (math.inf, -1))[0]) - 1e-9:
            seeds[other][there] = (d, index)
            shortened.append(other)
    return shortened


def _flat(grid: Grid, p_world: ArrayLike) -> int:
    """The flat index of the cell that a point (x, y[, z]) lies in."""
    row, col = (int(v) for v in grid.cells_of(p_world))
    return row * grid.cols + col
