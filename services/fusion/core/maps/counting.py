"""Counts what views show in each cell of a floor's maps, apart for measured and for estimated depth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.services.fusion.core.config import MapConfig

Counts = NDArray[np.uint32]
_MAX_COUNT = 2**32 - 1  # at which counts saturate
_FLOOR_TOLERANCE_M = 0.08  # a point within this of the floor's altitude is bare floor


@dataclass(slots=True, eq=False)
class CellCounts:
    """What views showed in each cell of a floor, all (rows, cols) uint32.

    Attributes:
        obstacle_points, obstacle_views: points at heights that block, and views with such points.
        floor_views: views that show nothing but bare floor.
        explored_views: views with a point, or with a ray that passes near the floor.
        drop_points, drop_views: rays that go down through a place where the floor should be, and views with such rays.
    """

    obstacle_points: Counts
    obstacle_views: Counts
    floor_views: Counts
    explored_views: Counts
    drop_points: Counts
    drop_views: Counts

    @classmethod
    def zeros(cls, rows: int, cols: int) -> CellCounts:
        return cls(*(np.zeros((rows, cols), np.uint32) for _ in fields(cls)))

    def layers(self) -> Iterator[tuple[str, Counts]]:
        """The names and arrays of all counts."""
        return ((field.name, getattr(self, field.name)) for field in fields(self))

    def add(
        self,
        p_world: NDArray[np.float32],
        p_camera: NDArray[np.float64],
        z_m: float,
        explored: NDArray[np.int16],
        corner: tuple[int, int],
        offset: tuple[int, int],
        max_explored_m: float,
        config: MapConfig,
    ) -> None:
        """Counts a view.

        Args:
            p_world: (N, 3) its points [m, world].
            p_camera: (3,) its camera [m, world].
            z_m: altitude of the floor.
            explored: (rows, cols) of a window: -1 where no ray of it passes. Cells with points are marked in it.
            corner: (row, col) of the window's first cell, counted from the world's origin.
            offset: the same cell, counted from the first of these counts.
            max_explored_m: farther points explore nothing.
        """
        part = np.s_[offset[0] : offset[0] + explored.shape[0], offset[1] : offset[1] + explored.shape[1]]
        count_points(
            p_world,
            p_camera,
            z_m,
            config.resolution_m,
            *corner,
            explored,
            max_explored_m**2,
            config.obstacle_min_m,
            config.obstacle_max_m,
            config.drop_min_m,
            config.obstacle_noise_per_m,
            config.explored_max_m,
            self.obstacle_points[part],
            self.obstacle_views[part],
            self.drop_points[part],
            self.drop_views[part],
            self.floor_views[part],
            self.explored_views[part],
        )

    def seen(self) -> NDArray[np.bool_]:
        """Cells of which a view showed anything."""
        return np.asarray((self.explored_views > 0) | (self.floor_views > 0) | (self.obstacle_points > 0))


@njit(cache=True, nogil=True)
def count_voxels_in_cells(  # type: ignore[no-untyped-def]
    centres, row0, col0, resolution_m, low, high, present, carved, n_present, n_carved
):
    for i in range(len(centres)):
        if low <= centres[i, 2] <= high:
            row = int(np.floor(centres[i, 1] / resolution_m)) - row0
            col = int(np.floor(centres[i, 0] / resolution_m)) - col0
            if 0 <= row < n_present.shape[0] and 0 <= col < n_present.shape[1]:
                n_present[row, col] += present
                n_carved[row, col] += carved


@njit(cache=True, nogil=True)
def count_points(  # type: ignore[no-untyped-def]
    points,
    p_camera,
    z,
    resolution_m,
    row0,
    col0,
    explored,
    max_explored_squared,
    low,
    high,
    drop,
    noise,
    explored_max,
    obstacle_points,
    obstacle_views,
    drop_points,
    drop_views,
    floor_views,
    explored_views,
):
    rows, cols = explored.shape
    obstacles = np.zeros((rows, cols), np.uint16)
    drops = np.zeros((rows, cols), np.uint16)
    bare = np.zeros((rows, cols), np.uint8)
    for i in range(points.shape[0]):
        x, y = np.float64(points[i, 0]), np.float64(points[i, 1])
        height = points[i, 2] - z
        dx, dy = points[i, 0] - p_camera[0], points[i, 1] - p_camera[1]
        squared = dx * dx + dy * dy
        is_drop = height < -drop - noise * squared
        if is_drop:  # there is no floor where the ray is this deep; above the point itself there may be one
            share = (p_camera[2] - z + drop) / (p_camera[2] - points[i, 2])
            if not 0.0 < share <= 1.0:
                continue
            x, y, squared = p_camera[0] + share * dx, p_camera[1] + share * dy, share * share * squared
        col = int(np.floor(x / resolution_m)) - col0
        row = int(np.floor(y / resolution_m)) - row0
        if height <= explored_max and squared <= max_explored_squared:  # a cell with a point is explored, whatever
            explored[row, col] = 0  # the ranges of its azimuth bin
        if is_drop:
            drops[row, col] += 1
        elif low + noise * squared <= height <= high:
            obstacles[row, col] += 1
        elif abs(height) <= _FLOOR_TOLERANCE_M:
            bare[row, col] = 1
    for row in range(rows):
        for col in range(cols):
            n_obstacle, n_drop = obstacles[row, col], drops[row, col]
            if n_obstacle > 0:
                obstacle_points[row, col] = min(_MAX_COUNT, int(obstacle_points[row, col]) + n_obstacle)
                obstacle_views[row, col] = min(_MAX_COUNT, int(obstacle_views[row, col]) + 1)
            if n_drop > 0:
                drop_points[row, col] = min(_MAX_COUNT, int(drop_points[row, col]) + n_drop)
                drop_views[row, col] = min(_MAX_COUNT, int(drop_views[row, col]) + 1)
            if n_obstacle == 0 and n_drop == 0 and bare[row, col] > 0:
                floor_views[row, col] = min(_MAX_COUNT, int(floor_views[row, col]) + 1)
            if explored[row, col] >= 0:
                explored_views[row, col] = min(_MAX_COUNT, int(explored_views[row, col]) + 1)
