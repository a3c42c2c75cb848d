"""The axis-aligned boxes of many shapes, for finding the near ones at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.fusion.core.objects.shape import Shape


class BoxTable:
    """The boxes of many shapes by id, in arrays: which of them are near is one comparison, however many there are."""

    def __init__(self) -> None:
        self._row: dict[int, int] = {}
        self._ids = np.zeros(16, np.int64)
        self._low, self._high = np.zeros((16, 3)), np.zeros((16, 3))

    def put(self, id_: int, shape: Shape) -> None:
        """Adds a box, or replaces the one of that id."""
        row = self._row.setdefault(id_, len(self._row))
        if row == len(self._ids):
            self._ids, self._low, self._high = (
                np.concatenate([a, np.zeros_like(a)]) for a in (self._ids, self._low, self._high)
            )
        self._ids[row], self._low[row], self._high[row] = id_, shape.p_min, shape.p_max

    def drop(self, id_: int) -> None:
        """Forgets a box; the last one takes its place."""
        row, last = self._row.pop(id_), len(self._row)
        if row != last:
            self._ids[row], self._low[row], self._high[row] = self._ids[last], self._low[last], self._high[last]
            self._row[int(self._ids[row])] = row

    def touching(self, shape: Shape, margin_m: float) -> list[int]:
        """Ids, in order, of the boxes that come within ``margin_m`` of the shape's."""
        n = len(self._row)
        near = (self._low[:n] <= shape.p_max + margin_m) & (self._high[:n] >= shape.p_min - margin_m)
        return sorted(self._ids[:n][near.all(axis=1)].tolist())

    def before(self, T_world_camera: NDArray[np.float64], far_m: float) -> list[int]:
        """Ids, in order, of the boxes whose middle lies before a camera and at most ``far_m`` from it."""
        n = len(self._row)
        middles = (self._low[:n] + self._high[:n]) / 2 - T_world_camera[:3, 3]
        near = (middles @ T_world_camera[:3, 2] > 0) & (np.einsum("ij,ij->i", middles, middles) <= far_m**2)
        return sorted(self._ids[:n][near].tolist())
