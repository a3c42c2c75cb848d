"""The robot's laser scanner: rays all around over the obstacles at its height."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Grid
from surveilnav.robot_state import RobotState
from surveilnav.simulator.world.geodesic import first_blocked, occupied_cells
from surveilnav.simulator.world.scene import Scene

#: Height of the scanner's plane above the floor, and half its thickness.
HEIGHT_M, _HALF_M = 0.2, 0.02
RANGE_M = (0.1, 12.0)
RAYS = 360


class Lidar:
    """Scans one floor of a scene, with the accuracy of the grid's cells."""

    def __init__(self, scene: Scene, grid: Grid, floor_z_m: float) -> None:
        low, high = floor_z_m + HEIGHT_M - _HALF_M, floor_z_m + HEIGHT_M + _HALF_M
        self._grid = grid
        self._open = ~occupied_cells(grid, scene.vertices, scene.triangles, low, high)

    def scan(self, state: RobotState) -> NDArray[np.float32]:
        """Ranges (RAYS,) [m], anticlockwise from straight behind; inf where nothing is within ``RANGE_M``."""
        grid = self._grid
        row, col = (
            (v - o) / grid.resolution_m for v, o in ((state.y_m, grid.origin_y_m), (state.x_m, grid.origin_x_m))
        )
        cells = _scan(self._open, row, col, state.yaw_rad - math.pi, RANGE_M[1] / grid.resolution_m, RAYS)
        ranges = (cells * grid.resolution_m).astype(np.float32)
        return np.where(ranges >= RANGE_M[0], ranges, np.float32(np.inf))


def _scan(
    open_: NDArray[np.bool_], row: float, col: float, first_rad: float, reach: float, rays: int
) -> NDArray[np.float64]:
    """Lengths (rays,) of rays from (row, col) to the first cell that isn't open, in cells; inf: none within ``reach``.

    Beyond the grid nothing is.
    """
    rows, cols = open_.shape
    lengths = np.full(rays, np.inf)
    for i in range(rays):
        angle = first_rad + 2 * math.pi * i / rays
        dr, dc = reach * math.sin(angle), reach * math.cos(angle)
        share = first_blocked(open_, row, col, row + dr, col + dc)
        if share > 1.0:
            continue
        r, c = row + (share + 1e-6) * dr, col + (share + 1e-6) * dc
        if 0 <= r < rows and 0 <= c < cols:
            lengths[i] = share * reach
    return lengths
