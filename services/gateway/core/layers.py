"""Map layers for people: as pictures (north up, one pixel per cell, transparent where there is nothing to show), as arrays,
and the joint cloud thinned to a number of points.

| layer | colour |
|---|---|
| occupancy | obstacle: slate ``#39424e``, half transparent where it is only estimated; what only a map from before has: teal
``#0b9e8e``, obstacles dark and free floor faint; else transparent |
| explored | explored: pale blue ``#dbe7f0``; unexplored: transparent |
| frontier | frontier: orange ``#f08c00``; else transparent |
| value | viridis (``#440154`` lowest to ``#fde725`` highest of this picture); unknown: transparent |
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Grid
from surveilnav.occupancy import ESTIMATED_OBSTACLE, PRIOR_FREE, PRIOR_OBSTACLE

#: Layers that have a picture, and their colour (red, green, blue); the value layer has a scale.
COLOURS: dict[str, tuple[int, int, int] | None] = {
    "occupancy": (0x39, 0x42, 0x4E),
    "explored": (0xDB, 0xE7, 0xF0),
    "frontier": (0xF0, 0x8C, 0x00),
    "value": None,
}
_ESTIMATED_ALPHA = 110
#: What only a map from before has: its colour, and how opaque obstacles and free floor are.
_PRIOR_COLOUR, _PRIOR_ALPHA = (0x0B, 0x9E, 0x8E), {PRIOR_OBSTACLE: 200, PRIOR_FREE: 40}
#: Larger maps are shown with several cells per pixel.
MAX_PIXELS = 4096 * 4096
#: The first size of the cubes that keep one point each [m], and the factor by which it grows until they are few enough.
_MIN_CUBE_M = 0.04
_CUBE_GROWTH = 1.2
#: Points farther away don't belong to a building [m]; remote numbers must not overflow the cubes' keys.
_MAX_COORDINATE_M = 10_000.0


@dataclass(frozen=True, slots=True)
class RenderedLayer:
    """A layer as bytes (PNG, or an array in numpy's format).

    Attributes:
        grid: its cells are the pixels or elements.
        low, high: the ends of the scale of values.
        views_left_out: how many views the values leave out.
    """

    data: bytes
    grid: Grid
    low: float | None = None
    high: float | None = None
    views_left_out: int = 0


def render(layer: str, grid: Grid, cells: NDArray, max_pixels: int = MAX_PIXELS) -> RenderedLayer:
    """The picture of ``cells`` (rows, cols): uint8 (0: nothing), or for ``value`` float with NaN where unknown.

    Row 0 of the grid is the lowest line of the picture.
    """
    if layer == "occupancy":
        cells = np.where(cells == PRIOR_FREE, 0, cells) if _is_too_large(grid, max_pixels) else cells  # walls must show
    grid, cells = _coarser(grid, cells, max_pixels)
    colour = COLOURS[layer]
    if colour is not None:
        rgba = colour_cells(cells, colour)
        if layer == "occupancy":
            rgba[cells == ESTIMATED_OBSTACLE, 3] = _ESTIMATED_ALPHA
            for value, alpha in _PRIOR_ALPHA.items():
                rgba[cells == value] = (*_PRIOR_COLOUR, alpha)
        return RenderedLayer(encode_png(rgba), grid)
    rgba, low, high = colour_values(cells)
    return RenderedLayer(encode_png(rgba), grid, low, high)


def npy(array: NDArray) -> bytes:
    """An array in numpy's format (.npy)."""
    file = io.BytesIO()
    np.save(file, np.ascontiguousarray(array), allow_pickle=False)
    return file.getvalue()


def as_array(layer: str, grid: Grid, cells: NDArray) -> RenderedLayer:
    """``cells`` as they are, in numpy's format (.npy); row 0 is the southernmost."""
    known = cells[np.isfinite(cells)] if layer == "value" else cells[:0]
    low, high = (float(known.min()), float(known.max())) if known.size else (None, None)
    return RenderedLayer(npy(cells), grid, low, high)


def transform(grid: Grid) -> list[list[float]]:
    """(3, 3): maps (column, row, 1) of a cell to the place of its centre (x, y, 1) [m, world]."""
    r = grid.resolution_m
    return [[r, 0.0, grid.origin_x_m + r / 2], [0.0, r, grid.origin_y_m + r / 2], [0.0, 0.0, 1.0]]


def colour_cells(cells: NDArray, colour: tuple[int, int, int]) -> NDArray[np.uint8]:
    """RGBA (rows, cols, 4): ``colour`` (red, green, blue) where a cell isn't 0, else transparent."""
    rgba = np.zeros((*cells.shape, 4), np.uint8)
    rgba[cells != 0] = (*colour, 255)
    return rgba


def colour_values(
    values: NDArray, low: float | None = None, high: float | None = None
) -> tuple[NDArray[np.uint8], float | None, float | None]:
    """RGBA (rows, cols, 4) of values in viridis, transparent where they aren't finite; and the scale's ends.

    The scale runs from the lowest to the highest finite value unless ``low`` and ``high`` are given.
    """
    known = np.isfinite(values)
    rgba = np.zeros((*values.shape, 4), np.uint8)
    if not known.any():
        return rgba, low, high
    low = float(values[known].min()) if low is None else low
    high = float(values[known].max()) if high is None else high
    span = max(high - low, 1e-9)
    scaled = np.clip((np.where(known, values, low).astype(np.float64) - low) / span, 0.0, 1.0)
    bgr = cv2.applyColorMap((scaled * 255).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    rgba[..., :3] = bgr[..., ::-1]
    rgba[..., 3] = 255
    rgba[~known] = 0
    return rgba, low, high


def encode_png(rgba: NDArray[np.uint8]) -> bytes:
    """A PNG with the last row (the largest world y) on top."""
    bgra = np.ascontiguousarray(rgba[::-1][..., [2, 1, 0, 3]])
    ok, data = cv2.imencode(".png", bgra, [cv2.IMWRITE_PNG_COMPRESSION, 3])
    if not ok:
        raise ValueError(f"a picture of shape {rgba.shape} can't be encoded")
    return data.tobytes()


def _is_too_large(grid: Grid, max_pixels: int) -> bool:
    return grid.rows * grid.cols > max_pixels


def _coarser(grid: Grid, cells: NDArray, max_pixels: int) -> tuple[Grid, NDArray]:
    """Joins n x n cells by their maximum (a thin wall stays a wall) until they fit ``max_pixels``."""
    n = math.ceil(math.sqrt(grid.rows * grid.cols / max_pixels))
    if n <= 1:
        return grid, cells
    empty = np.nan if cells.dtype.kind == "f" else 0
    padded = np.pad(cells, ((0, -grid.rows % n), (0, -grid.cols % n)), constant_values=empty)
    rows, cols = padded.shape[0] // n, padded.shape[1] // n
    joined = np.fmax.reduce(np.fmax.reduce(padded.reshape(rows, n, cols, n), axis=3), axis=1)
    return Grid(grid.origin_x_m, grid.origin_y_m, grid.resolution_m * n, rows, cols), joined


def thinned_cloud(cloud: NDArray[np.float32], max_points: int) -> NDArray[np.float32]:
    """At most ``max_points`` of a cloud's points, spread evenly: one point from each cube of a grid.

    The cubes are the smallest of which there are few enough. The result doesn't depend on the order of the points.

    Args:
        cloud: (N, 6) x, y, z [m, world], red, green, blue [0-1].
        max_points: of the result, (M, 6).
    """
    inside = np.all(np.isfinite(cloud), axis=1) & np.all(np.abs(cloud[:, :3]) < _MAX_COORDINATE_M, axis=1)
    points = cloud[inside]
    points = points[np.lexsort(points.T)]
    size_m = _MIN_CUBE_M
    chosen = points
    while len(chosen) > max_points:
        cells = np.floor(points[:, :3] / size_m).astype(np.int64) + (1 << 20)
        keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
        chosen = points[np.sort(np.unique(keys, return_index=True)[1])]
        size_m *= _CUBE_GROWTH
    return np.ascontiguousarray(chosen, np.float32)
