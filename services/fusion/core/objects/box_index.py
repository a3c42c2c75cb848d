"""An index of the axis-aligned boxes of many shapes, for finding those near a place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.fusion.core.objects.shape import Shape


class BoxIndex:
    """The boxes of many shapes by id, in arrays, so that a query is a single vectorised comparison with all of them."""

    def __init__(self) -> None:
        self._row: dict[int, int] = {}
        self._ids = np.zeros(16, np.int64)
        self._low, self._high = np.zeros((16, 3)), np.zeros((16, 3))  # corners [m, world]

    def put(self, id_: int, shape: Shape) -> None:
        """Adds the box of a shape, or replaces the one of that id."""
        row = self._row.setdefault(id_, len(self._row))
        if row == len(self._ids):
            self._ids, self._low, self._high = (
                np.concatenate([a, np.zeros_like(a)]) for a in (self._ids, self._low, self._high)
            )
        self._ids[row], self._low[row], self._high[row] = id_, shape.p_min, shape.p_max

    def remove(self, id_: int) -> None:
        """Removes a box. The last row moves to its place, so that rows stay contiguous."""
        row, last = self._row.pop(id_), len(self._row)
        if row != last:
            self._ids[row], self._low[row], self._high[row] = self._ids[last], self._low[last], self._high[last]
            self._row[int(self._ids[row])] = row

    def near(self, shape: Shape, margin_m: float) -> list[int]:
        """Ids, ascending, of the boxes within ``margin_m`` of the shape's box along every axis."""
        n = len(self._row)
        near = (self._low[:n] <= shape.p_max + margin_m) & (self._high[:n] >= shape.p_min - margin_m)
        return sorted(self._ids[:n][near.all(axis=1)].tolist())

    def in_front_of(self, T_world_camera: NDArray[np.float64], max_range_m: float) -> list[int]:
        """Ids, ascending, of the boxes whose centre lies in front of a camera and at most ``max_range_m`` from it."""
        n = len(self._row)
        to_centre = (self._low[:n] + self._high[:n]) / 2 - T_world_camera[:3, 3]
        is_ahead = to_centre @ T_world_camera[:3, 2] > 0
        is_near = np.einsum("ij,ij->i", to_centre, to_centre) <= max_range_m**2
        return sorted(self._ids[:n][is_ahead & is_near].tolist())
