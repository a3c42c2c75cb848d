"""Where one could walk in a building whose floors nobody has named: level surfaces with headroom, column by column.

A grid of vertical rays passes through all surfaces of the building. A level one that looks up, with headroom above, is
a place ("spot"); spots of neighbouring columns hang together where one can step from one to the other. So floors,
terraces and stairs become graphs, and so do tables and beds, which are small and can't be stepped onto.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from surveilnav.geometry import Grid
from surveilnav.simulator.world.raycast import NOTHING, RayCaster
from surveilnav.simulator.world.scene import Scene

#: What one steps up at once: stairs have risers of up to 0.22 m, and scans are off by some centimetres.
STEP_M = 0.28
HEADROOM_M = 1.5
RESOLUTION_M = 0.05
#: A robot's radius around a spot must be walkable, or it isn't wide enough to count.
WIDTH_M = 0.2
#: On stairs a little less will do: in scans their edges fray.
PASSABLE_M = 0.15
_MAX_COLUMNS = 1_000_000
_MAX_SURFACES = 64
#: If less than this share of the ground indoors looks up, nobody cared which side is which.
_TRUSTED = 0.1
_LEVEL = math.cos(math.radians(40.0))


@dataclass(frozen=True, slots=True, eq=False)
class Spots:
    """All N spots of a building.

    Attributes:
        grid: of the columns.
        column: (N,) int64, flat index into the grid; z_m: (N,) float64; clear_m: (N,) height above it, inf outdoors.
        neighbour: (4, N) int64, the spot that one steps onto in +col, -col, +row, -row; -1 for none.
        part: (N,) int32, connected part by number.
        wide: (N,) bool, there is ``WIDTH_M`` of walkable ground on all sides; passable: ``PASSABLE_M`` of it.
    """

    grid: Grid
    column: NDArray[np.int64]
    z_m: NDArray[np.float64]
    clear_m: NDArray[np.float64]
    neighbour: NDArray[np.int64]
    part: NDArray[np.int32]
    wide: NDArray[np.bool_]
    passable: NDArray[np.bool_]

    @property
    def cell_m2(self) -> float:
        return self.grid.resolution_m**2

    def p_world(self, spot: int) -> tuple[float, float, float]:
        """(x, y, z) [m] of a spot."""
        x, y = self.grid.centres_of(divmod(int(self.column[spot]), self.grid.cols))
        return float(x), float(y), float(self.z_m[spot])


def find_spots(scene: Scene, caster: RayCaster) -> Spots:
    """The spots of a scene. Surfaces that look down count too where next to none look up: a model inside out."""
    low, high = (scene.vertices[:, :2].min(axis=0), scene.vertices[:, :2].max(axis=0))
    area = float(np.prod(high - low + 4 * RESOLUTION_M))
    resolution = RESOLUTION_M * max(1, math.ceil(math.sqrt(area / RESOLUTION_M**2 / _MAX_COLUMNS)))
    col0, row0 = (math.floor(float(v) / resolution) - 1 for v in low)
    col1, row1 = (math.floor(float(v) / resolution) + 2 for v in high)
    grid = Grid(col0 * resolution, row0 * resolution, resolution, row1 - row0, col1 - col0)
    column, z, clear, upward = _surfaces(scene, caster, grid)
    chosen = clear >= HEADROOM_M
    indoors = chosen & np.isfinite(clear)
    if upward[indoors].sum() >= _TRUSTED * indoors.sum():
        chosen &= upward
    column, z, clear = column[chosen], z[chosen], clear[chosen]
    order = np.lexsort((z, column))
    column, z, clear = column[order], z[order], clear[order]
    neighbour = _neighbours(grid, column, z)
    part = _parts(neighbour)
    rounds, fewer = (math.ceil(round(width / resolution, 6)) for width in (WIDTH_M, PASSABLE_M))
    eroded = [np.ones(len(z), dtype=np.bool_)]
    for _ in range(rounds):
        eroded.append(np.logical_and.reduce([(n >= 0) & eroded[-1][n] for n in neighbour]) if len(z) else eroded[-1])
    return Spots(grid, column, z, clear, neighbour, part, eroded[rounds], eroded[fewer])


def _surfaces(
    scene: Scene, caster: RayCaster, grid: Grid
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Column, height, free height above and whether it looks up, of every level surface of every column."""
    corners = scene.vertices[scene.triangles].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    slope = normal[:, 2] / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
    columns = np.arange(grid.rows * grid.cols)
    xy = grid.centres_of(np.stack(np.divmod(columns, grid.cols), axis=-1))
    # Not quite through the middles: edges of modelled things like to lie on round numbers, and rays slip through them.
    xy = xy + np.array([0.0031, 0.0017])
    above = np.full(len(columns), np.inf)
    start = np.full(len(columns), float(scene.vertices[:, 2].max()) + 1.0)
    found: list[tuple[NDArray, NDArray, NDArray, NDArray]] = []
    for _ in range(_MAX_SURFACES):
        if not len(columns):
            break
        origins = np.column_stack([xy[columns], start]).astype(np.float32)
        hits = caster.cast(origins, np.broadcast_to(np.array([0, 0, -1], np.float32), origins.shape))
        hit = hits.triangle != NOTHING
        columns, above = columns[hit], above[hit]
        z = start[hit] - hits.t[hit]
        facing = slope[hits.triangle[hit]]
        level = np.abs(facing) > _LEVEL
        found.append((columns[level], z[level], (above - z)[level], facing[level] > 0))
        above, start = z, z - 0.002
    if not found:
        return np.zeros(0, np.int64), np.zeros(0), np.zeros(0), np.zeros(0, np.bool_)
    column, height, clear, upward = (np.concatenate(part) for part in zip(*found, strict=True))
    return column, height, clear, upward


def _neighbours(grid: Grid, column: NDArray[np.int64], z: NDArray[np.float64]) -> NDArray[np.int64]:
    """(4, N): see ``Spots.neighbour``. Spots are sorted by column, then height.

    Where the next column has none the one after it counts: rays that graze a riser find no tread.
    """
    count = np.bincount(column, minlength=grid.rows * grid.cols)
    first = np.cumsum(count) - count
    found = np.full((4, len(z)), -1, dtype=np.int64)
    row, col = np.divmod(column, grid.cols)
    for side, (dr, dc) in enumerate(((0, 1), (0, -1), (1, 0), (-1, 0))):
        for reach in (1, 2):
            to_row, to_col = row + reach * dr, col + reach * dc
            open_ = (found[side] < 0) & (to_row >= 0) & (to_row < grid.rows) & (to_col >= 0) & (to_col < grid.cols)
            there = np.where(open_, to_row * grid.cols + to_col, 0)
            nearest = np.full(len(z), STEP_M)
            for layer in range(int(count.max(initial=0))):
                has = open_ & (layer < count[there])
                spot = np.where(has, first[there] + layer, 0)
                rise = np.abs(z[spot] - z)
                better = has & (rise <= nearest)
                found[side, better], nearest[better] = spot[better], rise[better]
    return found


def _parts(neighbour: NDArray[np.int64]) -> NDArray[np.int32]:
    count = neighbour.shape[1]
    side, spot = np.nonzero(neighbour >= 0)
    edges = coo_matrix((np.ones(len(spot), np.int8), (spot, neighbour[side, spot])), shape=(count, count))
    return np.asarray(connected_components(edges, directed=False)[1], dtype=np.int32)
