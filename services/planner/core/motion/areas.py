"""Areas of a floor that are marked by people: where no robot is sent, and passages that are open or closed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Grid
from surveilnav.geometry.polygon import pixels_in
from surveilnav.robot_body import clearance_m, fits

AreaKind = Literal["keepout", "closed", "open"]


@dataclass(frozen=True, slots=True)
class Area:
    """An area of one floor.

    Attributes:
        name: what it is, for people: ``keepout zone 'server room'``, ``door entrance``.
        kind: ``keepout`` and ``closed`` (a passage) bar robots; in an ``open`` passage, obstacles that the map holds are old.
        outline_m: corners (x, y) [m, world].
        passage: the passage's id; empty for a keepout zone.
    """

    name: str
    kind: AreaKind
    outline_m: tuple[tuple[float, float], ...]
    passage: str = ""

    def contains(self, x_m: float, y_m: float) -> bool:
        """Whether a place lies in it or on its outline."""
        return cv2.pointPolygonTest(np.array(self.outline_m, dtype=np.float32), (x_m, y_m), False) >= 0


@dataclass(frozen=True, slots=True, eq=False)
class BarredCells:
    """Where a robot isn't sent, bool of a grid's shape each, read-only.

    Attributes:
        inside: cells that an area touches.
        near: these, and those from where the robot's body would reach into them.
    """

    inside: NDArray[np.bool_]
    near: NDArray[np.bool_]


@lru_cache(maxsize=16)
def barred_cells(grid: Grid, areas: tuple[Area, ...], radius_m: float) -> BarredCells | None:
    """The cells that keepout zones and closed passages bar for a robot of this radius; None: there are none."""
    rim = math.ceil(radius_m / grid.resolution_m) + 1  # so that areas just outside of the grid count too
    r = grid.resolution_m
    wider = Grid(grid.origin_x_m - rim * r, grid.origin_y_m - rim * r, r, grid.rows + 2 * rim, grid.cols + 2 * rim)
    inside = cells_in(wider, areas, "keepout", "closed")
    if not inside.any():
        return None
    near = ~fits(clearance_m(inside, r), radius_m)
    core = slice(rim, rim + grid.rows), slice(rim, rim + grid.cols)
    cells = BarredCells(inside[core].copy(), near[core].copy())
    cells.inside.flags.writeable = cells.near.flags.writeable = False
    return cells if cells.near.any() else None


def cells_in(grid: Grid, areas: tuple[Area, ...], *kinds: AreaKind) -> NDArray[np.bool_]:
    """(rows, cols) the cells that an area of these kinds touches, and one more all around."""
    low, size = (grid.origin_x_m, grid.origin_y_m), (grid.cols * grid.resolution_m, grid.rows * grid.resolution_m)
    outlines = [(np.array(area.outline_m) - low) / size for area in areas if area.kind in kinds]
    return pixels_in([[(float(x), float(y)) for x, y in outline] for outline in outlines], grid.cols, grid.rows)


def way_out(barred: BarredCells, cell: tuple[int, int]) -> NDArray[np.bool_]:
    """(rows, cols) the cells through which a robot that stands in an area may leave it: that area, and what surrounds it."""
    _, label = cv2.connectedComponents(barred.inside.astype(np.uint8), connectivity=8)
    own = label == label[cell]
    _, label_near = cv2.connectedComponents((barred.near & (~barred.inside | own)).astype(np.uint8), connectivity=8)
    return np.asarray(label_near == label_near[cell])
