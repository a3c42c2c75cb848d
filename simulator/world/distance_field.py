"""Geodesic distances over a whole building, stairs included, and the ways that they are lengths of."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surveilnav.simulator.world.geodesic import UNREACHED, spread

if TYPE_CHECKING:
    from surveilnav.simulator.world.navigation import NavigationMap

#: By floor, by cell: distance [m] of a place from which distances spread, and the stair that led there (-1: none).
_Seeds = dict[str, dict[int, tuple[float, int]]]


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


def distance_field(navigation: NavigationMap, goals: Mapping[str, ArrayLike]) -> DistanceField:
    """``NavigationMap.distance_field``."""
    seeds = _seeds_at(navigation, goals)
    distance = {name: np.full(f.free.size, np.inf) for name, f in navigation.floors.items()}
    parent = {name: np.full(f.free.size, UNREACHED, dtype=np.int32) for name, f in navigation.floors.items()}
    pending = [name for name in navigation.floors if seeds[name]]
    while pending:  # a floor is done again when a stair brings something shorter: ends, since ways only shrink
        name = pending.pop(0)
        distance[name], parent[name] = _spread_on(navigation, name, seeds[name])
        for other in _take_stairs(navigation, name, distance, seeds):
            if other not in pending:
                pending.append(other)
    stairs = {name: {cell: s for cell, (_, s) in seeds[name].items() if s >= 0} for name in navigation.floors}
    shaped = {n: d.astype(np.float32).reshape(navigation.floors[n].grid.shape) for n, d in distance.items()}
    return DistanceField(navigation, shaped, parent, stairs)


def _seeds_at(navigation: NavigationMap, goals: Mapping[str, ArrayLike]) -> _Seeds:
    """The goals' cells, at no distance."""
    seeds: _Seeds = {name: {} for name in navigation.floors}
    for name, points in goals.items():
        grid = navigation.floors[name].grid
        p = np.asarray(points, dtype=np.float64)
        if p.size == 0:
            continue
        cells = grid.cells_of(p.reshape(-1, p.shape[-1]))
        for row, col in cells[grid.contains(cells)]:
            seeds[name][int(row) * grid.cols + int(col)] = (0.0, -1)
    return seeds


def _spread_on(
    navigation: NavigationMap, name: str, seeds: dict[int, tuple[float, int]]
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Distance [m] and parent (cells,) on one floor."""
    floor = navigation.floors[name]
    r = floor.grid.resolution_m
    cost = np.array([d for d, _ in seeds.values()]) / r
    cells_away, parent = spread(floor.free, np.fromiter(seeds, dtype=np.int64), cost)
    return cells_away * r, parent


def _take_stairs(
    navigation: NavigationMap, name: str, distance: Mapping[str, NDArray[np.float64]], seeds: _Seeds
) -> list[str]:
    """Adds to ``seeds`` where stairs from floor ``name`` are shorter than what is known there; returns those floors."""
    shortened = []
    for index, transit in enumerate(navigation.transits):
        if name not in (transit.lower_floor, transit.upper_floor):
            continue
        other = transit.other_floor(name)
        here = _flat(navigation, transit.end_on(name), name)
        there = _flat(navigation, transit.end_on(other), other)
        d = float(distance[name][here]) + transit.length_m
        if d < min(distance[other][there], seeds[other].get(there, (math.inf, -1))[0]) - 1e-9:
            seeds[other][there] = (d, index)
            shortened.append(other)
    return shortened


def _flat(navigation: NavigationMap, p_world: ArrayLike, floor: str) -> int:
    grid = navigation.floors[floor].grid
    row, col = (int(v) for v in grid.cells_of(np.asarray(p_world, dtype=np.float64)[:2]))
    return row * grid.cols + col
