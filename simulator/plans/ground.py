"""Finds ground that a plan implies without drawing it: whatever its walls enclose and no room covers.

Many people draw walls and no rooms, or rooms for some of the floor only. All of it happens on cells of 5 cm on multiples
of 5 cm, the cells in which robots' ground is measured too; on larger ones where a storey spans more than 100 m.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from surveilnav.errors import BuildingError
from surveilnav.geometry import Grid
from surveilnav.simulator.world.polygons import Polygon, contains, signed_area

#: Sides of cells that are tried [m]; a storey of more than ``MAX_CELLS`` of the largest isn't filled: 400 x 400 m.
_CELLS_M = (0.05, 0.1, 0.2)
#: Of a storey's parts the largest are laid.
MAX_CELLS, MAX_PARTS = 4_000_000, 500
#: Gaps of at most these widths count as closed [m], tried one after the other: drawn carelessly, a passage without a
#: door, an open front.
_GAPS_M = (0.2, 1.2, 2.5, 5.0)
#: A gap is wide enough when what is enclosed is this share of what the widest encloses.
_ENOUGH = 0.7
#: A place that is an area of its own, not just a strip along a room: as wide and as large as this.
_AREA_WIDTH_M, _AREA_M2 = 0.6, 0.5
#: Strips smaller than this are rounding [m²]; one across a doorway is larger.
_STRIP_M2 = 0.03

Cells = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """A connected part of the ground.

    Attributes:
        outline: around all of it [m].
        tiles: rectangles that fill it, holes left out; they reach a cell under the walls and rooms around it.
        area_m2: without that cell.
        is_area: whether one can stand in it; else it is a strip that somebody left between room and wall.
    """

    outline: Polygon
    tiles: tuple[Polygon, ...]
    area_m2: float
    is_area: bool


def find_ground(walls: Sequence[Polygon], rooms: Sequence[Polygon]) -> tuple[Ground, ...]:
    """The ground of one storey, the largest part first.

    Args:
        walls: outlines of its walls, openings not cut out.
        rooms: outlines of whatever has a floor already.

    Raises:
        BuildingError: the storey is too large to fill.
    """
    if not walls:
        return ()
    grid = _grid_around([*walls, *rooms])
    covered = inside([*rooms, *walls], grid)
    bare = _enclosed([*walls, *rooms], grid) & ~covered
    label, count = ndimage.label(bare, np.ones((3, 3)))
    size_m2 = np.bincount(label.ravel(), minlength=count + 1)[1:] * grid.resolution_m**2
    where = ndimage.find_objects(label)
    largest = np.argsort(-size_m2, kind="stable")[:MAX_PARTS]
    return tuple(
        _ground_of(label[where[i]] == i + 1, where[i], grid) for i in largest.tolist() if size_m2[i] >= _STRIP_M2
    )


def without_voids(
    parts: Sequence[Ground], rooms: Sequence[Polygon], holes: Sequence[Polygon], below: Sequence[Polygon]
) -> tuple[Ground, ...]:
    """Leaves out the areas of an upper storey that are open to the storey below.

    If rooms are drawn for most of a storey, an area above a room was left undrawn on purpose: it is a void. The landing of a
    staircase is the exception.

    Args:
        parts: what no room covers.
        rooms: outlines of the storey's own rooms; ``holes``: of the staircases that come up; ``below``: of the rooms and
            grounds of the storey below.
    """
    areas_m2 = sum(part.area_m2 for part in parts if part.is_area)
    if sum(abs(signed_area(room)) for room in rooms) < areas_m2:
        return tuple(parts)

    def stays(part: Ground) -> bool:
        return not part.is_area or not _is_over(part, below) or any(_beside(part.outline, hole) for hole in holes)

    return tuple(part for part in parts if stays(part))


def _is_over(part: Ground, below: Sequence[Polygon]) -> bool:
    """Whether half of a part or more, by its tiles' middles, lies over one of the polygons."""
    over = [any(contains(room, tile.mean(axis=0)) for room in below) for tile in part.tiles]
    sizes = np.array([abs(signed_area(tile)) for tile in part.tiles])
    return bool(sizes[over].sum() >= sizes.sum() / 2)


def _beside(a: Polygon, b: Polygon) -> bool:
    """Whether the boxes of two polygons touch."""
    return bool(np.all(a.min(axis=0) - 0.1 <= b.max(axis=0)) and np.all(b.min(axis=0) - 0.1 <= a.max(axis=0)))


def _grid_around(polygons: Sequence[Polygon]) -> Grid:
    """A grid two cells wider than all of them."""
    points = np.concatenate(polygons)
    for cell_m in _CELLS_M:
        low = np.floor(points.min(axis=0) / cell_m) - 2
        cols, rows = np.ceil(points.max(axis=0) / cell_m) + 2 - low
        if cols <= 65536 and rows <= 65536 and rows * cols <= MAX_CELLS:
            return Grid(float(low[0]) * cell_m, float(low[1]) * cell_m, cell_m, int(rows), int(cols))
    width, depth = np.ptp(points, axis=0)
    raise BuildingError(f"walls span {width:.0f} x {depth:.0f} m, too much to lay a floor between them: draw rooms")


def inside(polygons: Sequence[Polygon], grid: Grid) -> Cells:
    """The cells whose centres lie in one of the polygons (even-odd rule, row by row)."""
    cells = np.zeros(grid.shape, dtype=np.bool_)
    for polygon in polygons:
        p = (np.asarray(polygon, dtype=np.float64) - (grid.origin_x_m, grid.origin_y_m)) / grid.resolution_m - 0.5
        (x0, y0), (x1, y1) = p.T, np.roll(p, -1, axis=0).T
        for row in range(max(0, math.ceil(y0.min())), min(grid.rows, math.floor(y0.max()) + 1)):
            crosses = (y0 > row) != (y1 > row)
            if not crosses.any():
                continue
            a, b, c, d = x0[crosses], y0[crosses], x1[crosses], y1[crosses]
            at = np.clip(np.ceil(np.sort(a + (row - b) / (d - b) * (c - a))), 0, grid.cols).astype(int)
            for first, last in zip(at[::2], at[1::2], strict=False):
                cells[row, first:last] = True
    return cells


def _enclosed(solid: Sequence[Polygon], grid: Grid) -> Cells:
    """The cells in the outline of what stands, with the narrowest gaps closed that make it nearly the whole."""
    thick = np.zeros(grid.shape, dtype=np.uint8)
    scale = 16  # of a pixel, for OpenCV; it paints whatever an outline touches, so that thin walls leave no gap
    for polygon in solid:
        p = (np.asarray(polygon) - (grid.origin_x_m, grid.origin_y_m)) / grid.resolution_m - 0.5
        cv2.fillPoly(thick, [np.round(p * scale).astype(np.int32)], 1, shift=4)
    found = [_closed(thick > 0, gap_m / grid.resolution_m) for gap_m in _GAPS_M]
    enough = _ENOUGH * float(found[-1].sum())
    return next(cells for cells in found if cells.sum() >= enough)


def _closed(solid: Cells, gap: float) -> Cells:
    """Solid cells and all that they enclose when gaps up to ``gap`` cells are none: a closing that fills holes."""
    reach = math.ceil(gap / 2)
    wide = cv2.distanceTransform((~np.pad(solid, reach + 1)).astype(np.uint8), cv2.DIST_L2, 5) <= reach
    filled = ndimage.binary_fill_holes(wide).astype(np.uint8)
    # One cell more than was added: whatever an outline touched was painted.
    closed = cv2.distanceTransform(np.pad(filled, 1), cv2.DIST_L2, 5)[1:-1, 1:-1] > reach + 1
    return np.asarray(closed[reach + 1 : -reach - 1, reach + 1 : -reach - 1])


def _ground_of(part: Cells, where: tuple[slice, slice], grid: Grid) -> Ground:
    """One connected part, whose box of cells in the grid is ``where``."""
    cell_m = grid.resolution_m
    origin = np.array([grid.origin_x_m, grid.origin_y_m]) + cell_m * np.array([where[1].start - 1, where[0].start - 1])
    padded = np.pad(part, 1)
    wide = cv2.dilate(padded.astype(np.uint8), np.ones((3, 3), np.uint8))
    contours, _ = cv2.findContours(padded.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = cv2.approxPolyDP(max(contours, key=len), 1.0, True)[:, 0]
    clear = cv2.distanceTransform(padded.astype(np.uint8), cv2.DIST_L2, 5).max() * cell_m
    area_m2 = float(part.sum()) * cell_m**2
    return Ground(
        (outline + 0.5) * cell_m + origin,
        tuple(tile * cell_m + origin for tile in _tiles(wide > 0)),
        area_m2,
        bool(len(outline) >= 3 and clear >= _AREA_WIDTH_M / 2 and area_m2 >= _AREA_M2),
    )


def _tiles(cells: Cells) -> list[Polygon]:
    """Rectangles, corners counter-clockwise in cells, that fill the cells: a row's runs, one as long as the next joined."""
    done: list[tuple[int, int, int, int]] = []
    growing: dict[tuple[int, int], int] = {}  # columns (first, last) of a run -> its first row
    for row, line in enumerate(np.vstack([cells, np.zeros_like(cells[:1])])):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(np.int8), [0]]))).tolist()
        runs = {(first, last) for first, last in zip(edges[::2], edges[1::2], strict=True)}
        done += [(first, last, growing.pop((first, last)), row) for first, last in sorted(set(growing) - runs)]
        growing |= {run: row for run in runs if run not in growing}
    return [np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=np.float64) for x0, x1, y0, y1 in done]
