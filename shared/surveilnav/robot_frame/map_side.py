"""A map as far as matching needs it: its obstacles, and how near each place is to one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Grid
from surveilnav.occupancy import PRIOR_FREE
from surveilnav.robot_frame.nav2_map import FREE, OCCUPIED, UNKNOWN, Nav2Map
from surveilnav.robot_frame.planar import PlanarTransform

_Array = NDArray[np.float64]
_Layer = NDArray[np.float32]
#: What a place where obstacles coincide by chance adds to the gain; one where they coincide exactly adds 1.
CHANCE = 0.5
#: Weight of the joint map's obstacles in the robot's map: a laser sees the legs of a table of which cameras see the top.
WEIGHT = 0.5
#: Transforms that differ by less are the same place.
SAME_M, SAME_RAD = 0.5, math.radians(8.0)


@dataclass(frozen=True, slots=True, eq=False)
class MapSide:
    """One of both maps, as far as matching needs it.

    Attributes:
        obstacles: (n, 2) centres of its occupied cells [m], in its frame.
        is_free: bool, free cells; ``is_known``: bool, cells that it knows.
        distance_m: float32, distance of each cell to the nearest occupied one.
        cell_m: side of a cell. ``T_frame_cells``: pose of the cells in the frame.
    """

    obstacles: _Array
    is_free: NDArray[np.bool_]
    is_known: NDArray[np.bool_]
    distance_m: _Layer
    cell_m: float
    T_frame_cells: PlanarTransform

    @classmethod
    def from_cells(cls, kinds: NDArray[np.uint8], cell_m: float, T_frame_cells: PlanarTransform) -> MapSide:
        """Of the window of all cells that are known."""
        rows, cols = (np.flatnonzero((kinds != UNKNOWN).any(axis=axis)) for axis in (1, 0))
        if not len(rows):
            rows = cols = np.zeros(1, np.int64)
        kinds = kinds[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
        T = T_frame_cells @ PlanarTransform(cols[0] * cell_m, rows[0] * cell_m)
        occupied = kinds == OCCUPIED
        distance_m = np.full(kinds.shape, 1e3, np.float32)
        if occupied.any():
            distance_m = (
                cv2.distanceTransform((~occupied).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * cell_m
            )
        at = np.argwhere(occupied)[:, ::-1] + 0.5
        return cls(T.apply(at * cell_m), kinds == FREE, kinds != UNKNOWN, np.asarray(distance_m, np.float32), cell_m, T)

    @classmethod
    def from_robot(cls, robot: Nav2Map) -> MapSide:
        return cls.from_cells(robot.cells, robot.resolution_m, robot.T_map_cells)

    @classmethod
    def from_joint(cls, grid: Grid, occupancy: NDArray[np.uint8], explored: NDArray[np.uint8]) -> MapSide:
        free = (explored != 0) | (occupancy == PRIOR_FREE)
        kinds = np.where(free & ((occupancy == 0) | (occupancy == PRIOR_FREE)), FREE, UNKNOWN).astype(np.uint8)
        kinds[(occupancy != 0) & (occupancy != PRIOR_FREE)] = OCCUPIED
        return cls.from_cells(kinds, grid.resolution_m, PlanarTransform(grid.origin_x_m, grid.origin_y_m))

    def field(self, sigma_m: float) -> _Layer:
        """What an obstacle of the other map adds to the gain in each cell.

        Where this map knows nothing, nothing is taken away. Close behind a wall something is added, though, as close before it:
        otherwise a wall would gain most where it stands before its counterpart.
        """
        near = np.exp(-0.5 * np.square(self.distance_m / sigma_m)) - CHANCE
        return np.asarray(np.where(self.is_known, near, np.maximum(near, 0.0)), np.float32)

    def sample(self, layer: _Layer, p: _Array, outside: float = 0.0) -> _Layer:
        """(n,) of a layer at places (n, 2) of the frame, interpolated."""
        if not len(p):
            return np.zeros(0, np.float32)
        cells = self.T_frame_cells.inverse().apply(p) / self.cell_m - 0.5
        n = math.ceil(len(cells) / 1000) * 1000  # OpenCV's pictures have at most 32,767 rows
        padded = np.concatenate([cells, np.full((n - len(cells), 2), -9.0)])
        at = padded.astype(np.float32).reshape(-1, 1000, 2)
        values = cv2.remap(layer, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=outside)
        return np.asarray(values.ravel()[: len(p)])


def is_same(one: PlanarTransform, other: PlanarTransform, pivot: _Array, times: float = 1.0) -> bool:
    """Whether two transforms put what lies at ``pivot`` (2,) in about the same place and direction."""
    off_m, off_rad = one.difference(other, pivot)
    return off_m < times * SAME_M and off_rad < times * SAME_RAD
