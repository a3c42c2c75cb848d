"""Top-down grids: where a cell lies in the world.

Row grows with world y, column with world x; cell (row, col) covers
``[origin_x + col * r, origin_x + (col + 1) * r)`` and likewise in y. Pictures flip rows so that north is up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, slots=True)
class Grid:
    """The frame of a 2D map: the world position of its corner, its resolution and its shape."""

    origin_x_m: float
    origin_y_m: float
    resolution_m: float
    rows: int
    cols: int

    def __post_init__(self) -> None:
        if not (math.isfinite(self.origin_x_m) and math.isfinite(self.origin_y_m)):
            raise ValueError("the origin of a grid must be finite")
        if not (self.resolution_m > 0 and math.isfinite(self.resolution_m)):
            raise ValueError(f"the resolution of a grid must be positive, got {self.resolution_m}")
        if not (0 < self.rows <= 65536 and 0 < self.cols <= 65536):
            raise ValueError(f"a grid has 1 to 65536 rows and columns, got {self.rows}x{self.cols}")

    @classmethod
    def centred(cls, x_m: float, y_m: float, extent_m: float, resolution_m: float) -> Grid:
        """A square grid of side ``extent_m`` around (x, y), its corner on a multiple of the resolution."""
        cells = max(1, round(extent_m / resolution_m))
        origin_x = math.floor((x_m - extent_m / 2) / resolution_m) * resolution_m
        origin_y = math.floor((y_m - extent_m / 2) / resolution_m) * resolution_m
        return cls(origin_x, origin_y, resolution_m, cells, cells)

    @property
    def shape(self) -> tuple[int, int]:
        return self.rows, self.cols

    def cells_of(self, p_world: ArrayLike) -> NDArray[np.int64]:
        """(row, col) (..., 2) of points (..., 2 or 3) in the world; may lie outside the grid."""
        p = np.asarray(p_world, dtype=np.float64)
        col = np.floor((p[..., 0] - self.origin_x_m) / self.resolution_m)
        row = np.floor((p[..., 1] - self.origin_y_m) / self.resolution_m)
        return np.stack([row, col], axis=-1).astype(np.int64)

    def centres_of(self, cells: ArrayLike) -> NDArray[np.float64]:
        """World (x, y) (..., 2) [m] of the centres of cells (..., 2) given as (row, col)."""
        c = np.asarray(cells, dtype=np.float64)
        x = self.origin_x_m + (c[..., 1] + 0.5) * self.resolution_m
        y = self.origin_y_m + (c[..., 0] + 0.5) * self.resolution_m
        return np.stack([x, y], axis=-1)

    def contains(self, cells: ArrayLike) -> NDArray[np.bool_]:
        """Whether cells (..., 2) lie inside the grid."""
        c = np.asarray(cells)
        return (c[..., 0] >= 0) & (c[..., 0] < self.rows) & (c[..., 1] >= 0) & (c[..., 1] < self.cols)
