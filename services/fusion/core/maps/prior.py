"""What is known of a floor before anybody has seen it: Nav2's map, placed in the building.

It is knowledge about geometry only. Its walls and its free floor count until a view shows something else there, and none of it
counts as seen: what stands there has still to be looked at.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import zstandard
from numpy.typing import NDArray

from surveilnav.geometry import Grid
from surveilnav.occupancy import PRIOR_FREE, PRIOR_OBSTACLE
from surveilnav.robot_frame import Nav2Map, PlanarTransform
from surveilnav.robot_frame.nav2_map import FREE, MAX_CELLS, OCCUPIED


@dataclass(frozen=True, slots=True, eq=False)
class PriorMap:
    """Nav2's map of a floor, and where its origin lies in the building."""

    nav2_map: Nav2Map
    T_building_map: PlanarTransform

    def extent(self) -> tuple[float, float, float, float]:
        """(x0, y0, x1, y1) [m, world] of the smallest rectangle around it."""
        return self.nav2_map.extent(self.T_building_map)

    def to_text(self) -> str:
        """All of it as text."""
        cells, T, T_map = self.nav2_map.cells, self.T_building_map, self.nav2_map.T_map_cells
        facts = [*cells.shape, self.nav2_map.resolution_m, T_map.x_m, T_map.y_m, T_map.yaw_rad, T.x_m, T.y_m, T.yaw_rad]
        packed = msgspec.msgpack.encode([facts, cells.tobytes()])
        return base64.b64encode(zstandard.ZstdCompressor().compress(packed)).decode()

    @classmethod
    def from_text(cls, text: Any) -> PriorMap:
        """Reads what ``to_text`` returned. Raises ValueError: it is something else."""
        try:
            data = base64.b64decode(text, validate=True)
            if zstandard.frame_content_size(data) > 2 * MAX_CELLS:
                raise ValueError("larger than any map")
            packed = zstandard.ZstdDecompressor().decompress(data)
            facts, cells = msgspec.msgpack.decode(packed, type=tuple[list[float], bytes])
            rows, cols, resolution_m, *rest = facts
            kinds = np.frombuffer(cells, np.uint8).reshape(int(rows), int(cols))
            x, y, yaw, *frame = rest
            return cls(Nav2Map(kinds, resolution_m, PlanarTransform(x, y, yaw)), PlanarTransform(*frame))
        except (ValueError, TypeError, zstandard.ZstdError, msgspec.MsgspecError) as error:
            raise ValueError(f"a map from before can't be read: {error}") from error

    def on_grid(self, grid: Grid) -> NDArray[np.uint8]:
        """(rows, cols) uint8 of a floor's grid: ``PRIOR_OBSTACLE``, ``PRIOR_FREE``, or 0 where it knows nothing."""
        kinds = self.nav2_map.on_grid(grid, self.T_building_map)
        out = np.zeros(grid.shape, np.uint8)
        out[kinds == FREE], out[kinds == OCCUPIED] = PRIOR_FREE, PRIOR_OBSTACLE
        return out
