"""The order in which camera views are perceived: first those that may still show most near a robot.

A camera sends all its views at once, and perception takes a while for each. The utility of a view is the area of unexplored
floor that it shows up to the first known obstacle, discounted by the distance to the nearest robot::

    utility = integral over the floor in view of  w(p) exp(-d(p) / distance_scale_m)  dA

w is 1 where the floor is unexplored, ``frontier_weight`` on a frontier and ``explored_weight`` elsewhere; d is the straight-line
distance to the nearest robot. The running system and the benchmark order views by the same function.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.geometry import Grid, Matrix4, Pinhole
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core.config import ViewOrderConfig
from surveilnav.services.fusion.core.maps.projection import AZIMUTHS

_AZIMUTH_STEP_RAD = math.radians(3.0)
#: A view that looks down more steeply than this sees the floor below its camera on all sides.
_STEEP_RAD = math.radians(65.0)
#: An obstacle nearer than this is the wall that the camera is mounted on.
_MOUNTING_WALL_M = 0.3


@dataclass(frozen=True, slots=True)
class ViewFootprint:
    """The part of a floor that a view looks at: an annular sector around the point (x, y) [m, world] below the camera.

    It covers ``half_width_rad`` to both sides of ``azimuth_rad``, at distances from ``from_m`` to ``to_m``.
    """

    floor_z_m: float
    x_m: float
    y_m: float
    azimuth_rad: float
    half_width_rad: float
    from_m: float
    to_m: float

    @classmethod
    def from_view(cls, T_world_camera: Matrix4, camera: Pinhole, floor_z_m: float, range_m: float) -> ViewFootprint:
        """The footprint of a view without roll, up to a horizontal distance of ``range_m``.

        Args:
            T_world_camera: (4, 4) pose of the view.
            floor_z_m: altitude of the floor [m, world].
        """
        x_m, y_m, z_m = (float(v) for v in T_world_camera[:3, 3])
        ahead = T_world_camera[:3, 2]
        down_rad = math.asin(min(1.0, max(-1.0, -float(ahead[2]))))
        height_m = max(0.0, z_m - floor_z_m)
        half_height_rad = math.atan(camera.height_px / (2.0 * camera.fy_px))
        nearest_rad, farthest_rad = down_rad + half_height_rad, down_rad - half_height_rad
        from_m = height_m / math.tan(nearest_rad) if 0.0 < nearest_rad < math.pi / 2 else 0.0
        to_m = height_m / math.tan(farthest_rad) if farthest_rad > 0.0 else range_m
        half_width_rad = math.pi if down_rad > _STEEP_RAD else camera.hfov_rad / 2.0
        azimuth_rad = math.atan2(float(ahead[1]), float(ahead[0]))
        return cls(floor_z_m, x_m, y_m, azimuth_rad, half_width_rad, min(from_m, range_m), min(to_m, range_m))


@dataclass(frozen=True, slots=True, eq=False)
class KnownFloor:
    """What is known of a floor: layers (rows, cols) uint8 of 0 and 1 on ``grid``. Nothing is known outside of it."""

    grid: Grid
    occupied: NDArray[np.uint8]
    explored: NDArray[np.uint8]
    frontier: NDArray[np.uint8]


def floor_utilities_m2(
    footprints: Sequence[ViewFootprint],
    floor: KnownFloor | None,
    robots_m: NDArray[np.float64],
    config: ViewOrderConfig,
) -> NDArray[np.float64]:
    """The utilities (K,) of views of one floor, in m2 of unexplored floor right beside a robot.

    Args:
        floor: what is known of the floor; None: nothing yet.
        robots_m: (R, 2) positions of the robots on the floor [m, world]. Without any, distance doesn't count.
    """
    rows = np.array([(f.x_m, f.y_m, f.azimuth_rad, f.half_width_rad, f.from_m, f.to_m) for f in footprints], np.float64)
    robots = np.ascontiguousarray(robots_m, np.float64).reshape(-1, 2)
    unknown = np.zeros((1, 1), np.uint8)
    grid = floor.grid if floor else Grid(0.0, 0.0, config.ray_step_m, 1, 1)
    layers = (floor.occupied, floor.explored, floor.frontier) if floor else (unknown, unknown, unknown)
    return _utilities(  # type: ignore[no-any-return]
        rows.reshape(-1, 6),
        robots,
        *layers,
        grid.origin_x_m,
        grid.origin_y_m,
        grid.resolution_m,
        config.ray_step_m,
        config.distance_scale_m,
        config.frontier_weight,
        config.explored_weight,
    )


def visible_ranges_m(footprint: ViewFootprint, floor: KnownFloor | None) -> NDArray[np.float32]:
    """The horizontal ranges that a view without depth shows, by azimuth: up to the first known obstacle.

    Returns:
        (360, 2) float32, as ``maps.projection.azimuth_ranges``; (0, 0) where the view doesn't look.
    """
    f = footprint
    out = np.zeros((AZIMUTHS, 2), np.float32)
    azimuths_rad = (np.arange(AZIMUTHS) + 0.5) * (2 * math.pi / AZIMUTHS)
    off_axis_rad = np.abs((azimuths_rad - f.azimuth_rad + math.pi) % (2 * math.pi) - math.pi)
    bins = np.nonzero(off_axis_rad <= f.half_width_rad)[0]
    if f.to_m <= f.from_m:
        return out
    out[bins, 0], out[bins, 1] = f.from_m, f.to_m
    if floor is None:
        return out
    r_m = np.arange(floor.grid.resolution_m, f.to_m, floor.grid.resolution_m)
    directions = np.stack([np.cos(azimuths_rad[bins]), np.sin(azimuths_rad[bins])], axis=-1)
    cells = floor.grid.cells_of(np.array([f.x_m, f.y_m]) + directions[:, None] * r_m[:, None])
    inside = floor.grid.contains(cells)
    row, col = np.where(inside[..., None], cells, 0).transpose(2, 0, 1)
    blocked = inside & (floor.occupied[row, col] > 0) & (r_m > _MOUNTING_WALL_M)
    out[bins, 1] = np.where(blocked.any(axis=1), r_m[blocked.argmax(axis=1)], f.to_m)
    out[out[:, 1] <= out[:, 0]] = 0.0
    return out


def in_order(views: Iterable[PosedView]) -> list[PosedView]:
    """The order in which the views of one step are integrated: by time, then source, then view."""
    return sorted(views, key=lambda v: (v.stamp_ns, v.source, v.view, v.seq))


def highest_first(utilities_m2: NDArray[np.float64]) -> list[int]:
    """Indices of the views by descending utility; views of equal utility stay in their order."""
    order: list[int] = np.argsort(-utilities_m2, kind="stable").tolist()
    return order


@njit(cache=True, nogil=True)
def _utilities(  # type: ignore[no-untyped-def]
    footprints,
    robots,
    occupied,
    explored,
    frontier,
    x0,
    y0,
    resolution,
    step,
    distance_scale,
    frontier_weight,
    explored_weight,
):
    rows, cols = explored.shape
    out = np.zeros(len(footprints))
    for k in range(len(footprints)):
        x, y, azimuth, half_width, begin, end = footprints[k]
        n = max(1, int(np.ceil(2.0 * half_width / _AZIMUTH_STEP_RAD)))
        width = 2.0 * half_width / n
        for i in range(n):
            angle = azimuth - half_width + (i + 0.5) * width
            c, s = np.cos(angle), np.sin(angle)
            r = 0.5 * step
            while r < end:
                px, py = x + r * c, y + r * s
                col, row = int(np.floor((px - x0) / resolution)), int(np.floor((py - y0) / resolution))
                inside = 0 <= row < rows and 0 <= col < cols
                if inside and occupied[row, col] and r > step:  # beyond the wall that the camera is mounted on
                    break
                if r >= begin:
                    weight = 1.0
                    if inside and frontier[row, col]:
                        weight = frontier_weight
                    elif inside and explored[row, col]:
                        weight = explored_weight
                    out[k] += weight * _discount(px, py, robots, distance_scale) * r * width * step
                r += step
    return out


@njit(cache=True, nogil=True)
def _discount(x, y, robots, distance_scale):  # type: ignore[no-untyped-def]
    if len(robots) == 0:
        return 1.0
    nearest_squared = np.inf
    for i in range(len(robots)):
        nearest_squared = min(nearest_squared, (x - robots[i, 0]) ** 2 + (y - robots[i, 1]) ** 2)
    return np.exp(-np.sqrt(nearest_squared) / distance_scale)
