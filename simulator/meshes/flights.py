"""Stairs between floors, found as walkable ground that climbs from one to the other."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from surveilnav.robot_body import CLIMB_M, HEIGHT_M, clearance_m, fits
from surveilnav.simulator.meshes.floors import FloorGround
from surveilnav.simulator.meshes.walkable import Spots
from surveilnav.simulator.world.geodesic import occupied_cells
from surveilnav.simulator.world.scene import Scene, Stair, point3

#: The way over a stair runs at most so far over the floors at its ends [m].
_REACH_M = 2.0


def find_stairs(scene: Scene, spots: Spots, grounds: tuple[FloorGround, ...]) -> tuple[Stair, ...]:
    """One transit per flight of steps or ramp that is wide enough for a robot and joins two floors.

    The ends are where a robot can stand, the length is that of the shortest way between them over the treads.
    """
    if len(grounds) < 2:
        return ()
    on_floor = np.logical_or.reduce([s.on for s in grounds])
    free = {s.floor.id: _free(scene, spots, s) for s in grounds}
    flight = _parts_within(spots, spots.passable & ~on_floor)
    found: list[Stair] = []
    for number in range(1, int(flight.max(initial=0)) + 1):
        mine = flight == number
        beside = spots.neighbour[:, mine]
        touched = np.zeros(len(mine), np.bool_)
        touched[beside[beside >= 0]] = True
        joined = [s for s in grounds if (touched & s.on).any()]
        for lower, upper in pairwise(joined):
            stair = _way(spots, mine, lower, upper, free)
            if stair is not None:
                found.append(stair)
    return tuple(found)


def _free(scene: Scene, spots: Spots, ground: FloorGround) -> NDArray[np.bool_]:
    """(N,) which spots of a floor a robot's centre may take."""
    grid = spots.grid
    cells = np.zeros(grid.rows * grid.cols, np.bool_)
    cells[spots.column[ground.on]] = True
    z_m = ground.floor.z_m
    blocked = occupied_cells(grid, scene.vertices, scene.triangles, z_m + CLIMB_M, z_m + HEIGHT_M)
    room = np.pad(cells.reshape(grid.shape) & ~blocked, 1)
    free = fits(clearance_m(~room, grid.resolution_m))[1:-1, 1:-1]
    return np.asarray(ground.on & free.ravel()[spots.column])


def _edges(spots: Spots, allowed: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Steps from spot to spot among the allowed ones."""
    side, here = np.nonzero((spots.neighbour >= 0) & allowed)
    there = spots.neighbour[side, here]
    keep = allowed[there]
    return here[keep], there[keep]


def _parts_within(spots: Spots, allowed: NDArray[np.bool_]) -> NDArray[np.int32]:
    """(N,) number of the connected part of the allowed spots, from 1; 0 for the others."""
    here, there = _edges(spots, allowed)
    graph = coo_matrix((np.ones(len(here), np.int8), (here, there)), shape=(len(allowed), len(allowed)))
    label = connected_components(graph, directed=False)[1]
    _, numbers = np.unique(label[allowed], return_inverse=True)
    result = np.zeros(len(allowed), np.int32)
    result[allowed] = numbers + 1
    return result


def _way(
    spots: Spots, flight: NDArray[np.bool_], lower: FloorGround, upper: FloorGround, free: dict[str, NDArray[np.bool_]]
) -> Stair | None:
    """The shortest way over a flight from free ground to free ground; None where a robot has no room at an end."""
    row, col = np.divmod(spots.column, spots.grid.cols)
    reach = _REACH_M / spots.grid.resolution_m
    near = np.ones(len(flight), np.bool_)
    for axis in (row, col):
        near &= (axis >= axis[flight].min() - reach) & (axis <= axis[flight].max() + reach)
    allowed = flight | (near & (lower.on | upper.on))
    starts = np.flatnonzero(near & free[lower.floor.id])
    ends = np.flatnonzero(near & free[upper.floor.id])
    if not len(starts) or not len(ends):
        return None
    index = np.cumsum(allowed) - 1
    here, there = _edges(spots, allowed)
    step = np.hypot(spots.grid.resolution_m, spots.z_m[here] - spots.z_m[there])
    size = int(allowed.sum())
    graph = coo_matrix((step, (index[here], index[there])), shape=(size, size)).tocsr()
    distance, before, _ = dijkstra(graph, indices=index[starts], min_only=True, return_predecessors=True)
    best = ends[np.argmin(distance[index[ends]])]
    if not np.isfinite(distance[index[best]]):
        return None
    spot_of = np.flatnonzero(allowed)
    way = [int(index[best])]
    while before[way[-1]] >= 0:
        way.append(int(before[way[-1]]))
    points = np.array([spots.p_world(int(spot_of[i])) for i in reversed(way)])
    foot, head = point3([*points[0, :2], lower.floor.z_m]), point3([*points[-1, :2], upper.floor.z_m])
    return Stair(lower.floor.id, upper.floor.id, foot, head, _smoothed_length(points))


def _smoothed_length(points: NDArray[np.float64]) -> float:
    """Length [m] of a way of steps along rows and columns, as somebody walks it: straightened over half a metre."""
    if len(points) < 2:
        return 0.0
    padded = np.pad(points, ((5, 5), (0, 0)), mode="edge")
    smooth = np.stack([np.convolve(padded[:, k], np.full(11, 1 / 11), "valid") for k in range(3)], axis=1)
    smooth[0], smooth[-1] = points[0], points[-1]
    return float(np.linalg.norm(np.diff(smooth, axis=0), axis=1).sum())
