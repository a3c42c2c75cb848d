"""From where a robot sees a thing near by: Habitat's viewpoints.

A viewpoint is a place on the robot's ground, at most 1 m from an object's axis-aligned box (in the plane), from which
the robot's camera sees it in some direction. (habitat-lab ``object_nav_generator.py``.)

This is the simulator's own truth: no robot, map or planner may use it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surveilnav.robot_body import CAMERA_HEIGHT_M
from surveilnav.simulator.world.free_ground import FloorNavigation
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.raycast import RayCaster
from surveilnav.simulator.world.scene import Instance, Scene

VIEWPOINT_REACH_M = 1.0
#: Share of an object's surface (all sides, so half is hidden at best) that a viewpoint must see.
MIN_VISIBLE = 0.05
#: Points per object that visibility is tested with.
_SAMPLES = 128
#: Of the places near a thing every so many are tried first: most things are seen from most of them.
_FEW = 16


def is_reachable(scene: Scene, navigation: NavigationMap, instance: Instance, caster: RayCaster) -> bool:
    """Whether an instance has a viewpoint."""
    cells = _cells_near(navigation, instance)
    if len(cells) == 0:
        return False
    floor, surface = navigation.floors[instance.floor], surface_of(scene, instance)
    return any(
        bool((visible_share(caster, eyes_over(floor, some), surface) >= MIN_VISIBLE).any())
        for some in (cells[::_FEW], cells)
    )


def viewpoints_of(
    navigation: NavigationMap, instance: Instance, surface: NDArray[np.float32], caster: RayCaster
) -> NDArray[np.bool_] | None:
    """(rows, cols) cells of the instance's floor that are viewpoints of it, or None if none is.

    ``surface``: (m, 3) points on it, see ``surface_of``.
    """
    cells = _cells_near(navigation, instance)
    if len(cells) == 0:
        return None
    floor = navigation.floors[instance.floor]
    cells = cells[visible_share(caster, eyes_over(floor, cells), surface) >= MIN_VISIBLE]
    if len(cells) == 0:
        return None
    mask = np.zeros(floor.grid.shape, dtype=np.bool_)
    mask[cells[:, 0], cells[:, 1]] = True
    return mask


def _cells_near(navigation: NavigationMap, instance: Instance) -> NDArray[np.int64]:
    """(n, 2) cells of its floor, where robots live, within ``VIEWPOINT_REACH_M`` of an instance's box."""
    floor = navigation.floors.get(instance.floor)
    if floor is None:
        return np.empty((0, 2), dtype=np.int64)
    low, high = np.array(instance.p_min[:2]), np.array(instance.p_max[:2])
    (row0, col0), (row1, col1) = floor.grid.cells_of(np.array([low - VIEWPOINT_REACH_M, high + VIEWPOINT_REACH_M]))
    row0, col0 = max(0, int(row0)), max(0, int(col0))
    near = np.argwhere(navigation.robot_area[floor.id][row0 : max(0, row1 + 1), col0 : max(0, col1 + 1)])
    cells = near + np.array([row0, col0])
    xy = floor.grid.centres_of(cells)
    away = np.linalg.norm(xy - np.clip(xy, low, high), axis=1)
    return np.asarray(cells[away <= VIEWPOINT_REACH_M])


def surface_of(scene: Scene, instance: Instance) -> NDArray[np.float32]:
    """(n, 3) points evenly over the triangles of an instance, always the same; in its box if it has none."""
    corners = scene.vertices[scene.triangles[scene.instance_of_triangle == instance.id]].astype(np.float64)
    rng = np.random.default_rng([instance.id])
    if len(corners):
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        if area.sum() > 0:
            chosen = corners[rng.choice(len(corners), size=_SAMPLES, p=area / area.sum())]
            u, v = rng.random((2, _SAMPLES, 1))
            u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
            points = chosen[:, 0] + u * (chosen[:, 1] - chosen[:, 0]) + v * (chosen[:, 2] - chosen[:, 0])
            return np.asarray(points, dtype=np.float32)
    low, high = np.array(instance.p_min), np.array(instance.p_max)
    return np.asarray(low + rng.random((_SAMPLES, 3)) * (high - low), dtype=np.float32)


def visible_share(caster: RayCaster, eyes: NDArray[np.float32], surface: NDArray[np.float32]) -> NDArray[np.float64]:
    """(n,) share of the points (m, 3) that each eye (n, 3) sees, whatever direction they lie in."""
    share = np.empty(len(eyes))
    chunk = max(1, 400_000 // len(surface))  # bounds the rays in memory
    for i in range(0, len(eyes), chunk):
        some = eyes[i : i + chunk, None, :]
        hidden = caster.occluded(some, np.broadcast_to(surface, (len(some), *surface.shape)))
        share[i : i + chunk] = 1.0 - hidden.mean(axis=1)
    return share


def eyes_over(floor: FloorNavigation, cells: NDArray[np.int64]) -> NDArray[np.float32]:
    """(n, 3) where the robot's camera is when it stands in each of the cells (n, 2) [m, world]."""
    xy = floor.grid.centres_of(cells)
    return np.column_stack([xy, np.full(len(xy), floor.z_m + CAMERA_HEIGHT_M)]).astype(np.float32)
