"""What is known of a floor before anybody has seen it: Nav2's map, placed in the building.

It is knowledge about geometry only. Its walls and its free floor count until a view shows something else there, and none of it
counts as seen: what stands there has still to be looked at.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Grid
from surveilnav.occupancy import PRIOR_FREE, PRIOR_OBSTACLE
from surveilnav.robot_frame import Nav2Map, PlanarTransform
from surveilnav.robot_frame.nav2_map import FREE, OCCUPIED


@dataclass(frozen=True, slots=True, eq=False)
class PriorMap:
    """Nav2's map of a floor, and where its origin lies in the building."""

    nav2_map: Nav2Map
    T_building_map: PlanarTransform

    def extent(self) -> tuple[float, float, float, float]:
        """(x0, y0, x1, y1) [m, world] of the smallest rectangle around it."""
        return self.nav2_map.extent(self.T_building_map)

    def on_grid(self, grid: Grid) -> NDArray[np.uint8]:
        """(rows, cols) uint8 of a floor's grid: ``PRIOR_OBSTACLE``, ``PRIOR_FREE``, or 0 where it knows nothing."""
        kinds = self.nav2_map.on_grid(grid, self.T_building_map)
        out = np.zeros(grid.shape, np.uint8)
        out[kinds == FREE], out[kinds == OCCUPIED] = PRIOR_FREE, PRIOR_OBSTACLE
        return out
