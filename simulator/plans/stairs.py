"""Where one steps on and off a flight of stairs, read off its treads."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from surveilnav.simulator.world.assembly import Mesh
from surveilnav.simulator.world.scene import Stair, point3

#: A tread is level and at least this large [m²].
_MIN_TREAD_M2 = 0.04
#: Free space that a robot needs around the point where it steps on or off [m].
_CLEARANCE_M = 0.26
#: Nearer than this to the way off the tread, something blocks it [m].
_BLOCKED_M = 0.1
#: What stands between these heights above a floor is in a robot's way [m].
_OBSTACLE_LOW_M, _OBSTACLE_HIGH_M = 0.12, 1.2
_SEARCH_M = 1.6
_SAMPLE_M = 0.06

IsFloor = Callable[[NDArray[np.float64]], bool]


def treads(mesh: Mesh, z_low_m: float, z_high_m: float) -> NDArray[np.float64]:
    """Centres (n, 3) of the level faces between the floors, from below to above."""
    corners = mesh.vertices[mesh.triangles].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(normal, axis=1)
    centre = corners.mean(axis=1)
    level = (np.abs(normal[:, 2]) > 0.95 * np.maximum(twice, 1e-12)) & (twice > 1e-9)
    level &= (normal[:, 2] > 0) & (centre[:, 2] > z_low_m + 0.05) & (centre[:, 2] < z_high_m + 0.05)
    if not level.any():
        return np.zeros((0, 3))
    step = np.round(centre[level, 2] / 0.03).astype(int)
    found = []
    for value in np.unique(step):
        chosen = step == value
        weight = twice[level][chosen]
        if weight.sum() / 2 >= _MIN_TREAD_M2:
            found.append(np.average(centre[level][chosen], axis=0, weights=weight))
    return np.array(found).reshape(-1, 3)


def find_transit(
    flight: Mesh,
    meshes: Iterable[Mesh],
    lower: tuple[str, float],
    upper: tuple[str, float],
    is_floor: tuple[IsFloor, IsFloor],
) -> Stair | None:
    """The transit along a flight between two floors, or None if it has no treads.

    Args:
        flight: the stairs, in the world.
        meshes: everything that may stand in the way (the flight included).
        lower, upper: id and altitude of the floors.
        is_floor: whether there is floor at (x, y), below and above.
    """
    steps = treads(flight, lower[1], upper[1])
    if len(steps) < 3:
        return None
    meshes = list(meshes)
    below = _free_point(steps[0], steps[0] - steps[1], lower[1], meshes, is_floor[0])
    above = _free_point(steps[-1], steps[-1] - steps[-2], upper[1], meshes, is_floor[1])
    way = np.vstack([below, steps, above])
    length = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
    return Stair(lower[0], upper[0], point3(below), point3(above), length)


def _free_point(
    tread: NDArray[np.float64], away: NDArray[np.float64], z_m: float, meshes: list[Mesh], is_floor: IsFloor
) -> NDArray[np.float64]:
    """The nearest free point off a tread, straight ahead if possible; straight ahead anyway if nothing is free."""
    obstacles = cKDTree(np.unique(np.round(_obstacle_points(meshes, tread, z_m), 2), axis=0))
    heading = math.atan2(away[1], away[0])
    going = float(np.hypot(away[0], away[1]))
    straight = None
    best: tuple[float, NDArray[np.float64]] | None = None
    for turn in (0, 15, -15, 30, -30, 45, -45, 60, -60, 75, -75, 90, -90):
        for reach in np.arange(0.15, _SEARCH_M - 0.3, 0.05):
            angle = heading + math.radians(turn)
            r = going / 2 + float(reach)
            p = np.array([tread[0] + r * math.cos(angle), tread[1] + r * math.sin(angle), z_m])
            clearance_m = obstacles.query(p[:2])[0] if obstacles.n else math.inf
            if clearance_m < _BLOCKED_M:
                break  # a wall: what lies behind it can't be stepped onto
            if reach < 0.3:
                continue
            if straight is None:
                straight = p
            if clearance_m < _CLEARANCE_M or not is_floor(p[:2]):
                continue
            cost = r + 0.01 * abs(turn)
            if best is None or cost < best[0]:
                best = (cost, p)
            break
    if best is not None:
        return best[1]
    return straight if straight is not None else tread


def _obstacle_points(meshes: list[Mesh], around: NDArray[np.float64], z_m: float) -> NDArray[np.float64]:
    """Points (n, 2) on whatever stands within reach at a robot's height."""
    found = []
    z0, z1 = z_m + _OBSTACLE_LOW_M, z_m + _OBSTACLE_HIGH_M
    low, high = np.array([*(around[:2] - 2 * _SEARCH_M), z0]), np.array([*(around[:2] + 2 * _SEARCH_M), z1])
    for mesh in meshes:
        if (
            len(mesh.vertices) == 0
            or np.any(mesh.vertices.max(axis=0) < low)
            or np.any(mesh.vertices.min(axis=0) > high)
        ):
            continue
        corners = mesh.vertices[mesh.triangles].astype(np.float64)
        near = corners[~(np.any(corners.max(axis=1) < low, axis=1) | np.any(corners.min(axis=1) > high, axis=1))]
        sides = np.linalg.norm(near - np.roll(near, 1, axis=1), axis=2).max(axis=1, initial=0.0)
        count = np.minimum(200, np.ceil(sides / _SAMPLE_M)).astype(int)
        for n in np.unique(count):  # triangles of about one size are sampled together
            weights = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / max(n, 1)
            points = np.einsum("sk,tkc->tsc", weights, near[count == n]).reshape(-1, 3)
            keep = (points[:, 2] > z0) & (points[:, 2] < z1)
            keep &= np.hypot(points[:, 0] - around[0], points[:, 1] - around[1]) < _SEARCH_M + 0.5
            found.append(points[keep, :2])
    return np.concatenate(found) if found else np.zeros((0, 2))
