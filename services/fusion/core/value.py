"""The joint value map: how much the pictures that show a place sound like the target (eq. 2).

What is kept of a view is its image embedding and its reach; scores come in only when somebody names a target, so a
new target gets its map from everything seen so far without one new byte from a camera.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from services.fusion.core.config import ValueConfig
from services.fusion.core.projection import AZIMUTHS, camera_position, extent, sweep
from surveilnav.geometry import Grid
from surveilnav.sensing.views import PosedView

_STEEP = math.radians(60)  # a camera that looks down more steeply has no azimuth worth a cone


@dataclass(frozen=True, slots=True, eq=False)
class SeenView:
    """What the value map keeps of a view (2 to 4 kB)."""

    is_robot: bool
    x_m: float
    y_m: float
    reach_m: NDArray[np.float16]  # (360, 2)
    axis_rad: float
    half_fov_rad: float  # 0: no cone, the same weight everywhere
    embedding: NDArray[np.float16]

    @classmethod
    def of(cls, view: PosedView, reach_m: NDArray[np.float32], embedding: NDArray[np.float32]) -> SeenView:
        """``reach_m`` (360, 2) from ``projection.reach``; ``embedding`` (D,) unit length."""
        x, y, _ = camera_position(view.T_world_camera)
        forward = view.T_world_camera[:3, 2]
        steep = abs(math.asin(max(-1.0, min(1.0, float(forward[2]))))) > _STEEP
        return cls(
            view.is_robot, float(x), float(y), reach_m.astype(np.float16), math.atan2(forward[1], forward[0]),
            0.0 if steep else view.camera.hfov_rad / 2, embedding.astype(np.float16),
        )  # fmt: skip


class ValueMap:
    """Keeps views of a storey, and the value layers of the targets asked for last, up to date."""

    def __init__(self, config: ValueConfig) -> None:
        self._config = config
        self._views: OrderedDict[tuple[str, int, int], SeenView] = OrderedDict()
        self._layers: OrderedDict[bytes, _Layer] = OrderedDict()

    def __len__(self) -> int:
        return len(self._views)

    def add(self, view: PosedView, reach_m: NDArray[np.float32], embedding: NDArray[np.float32]) -> None:
        """Adds a view. A camera's view takes the place of its former self; a robot's are all kept, up to a limit."""
        key = (view.source, view.view, view.seq if view.is_robot else 0)
        if self._views.pop(key, None) is not None:
            self._layers.clear()  # what the old one contributed can't be taken out again: layers start anew
        seen = self._views[key] = SeenView.of(view, reach_m, embedding)
        for layer in self._layers.values():
            layer.add(seen)
        if len(self._views) > self._config.max_views:
            oldest = next((k for k, v in self._views.items() if v.is_robot), next(iter(self._views)))
            del self._views[oldest]

    def layer(self, grid: Grid, text_embedding: NDArray[np.floating]) -> NDArray[np.float32]:
        """The value map (rows, cols) float32 on ``grid`` for a text embedding (D,); NaN where nothing was seen."""
        text = np.asarray(text_embedding, np.float32)
        key = text.tobytes()
        layer = self._layers.get(key)
        if layer is None:
            layer = self._layers[key] = _Layer(text, grid.resolution_m, self._config)
            for view in self._views.values():
                layer.add(view)
        self._layers.move_to_end(key)
        while len(self._layers) > self._config.max_targets:
            self._layers.popitem(last=False)
        return layer.on(grid)


class _Layer:
    """The value layer of one target; grows as needed."""

    def __init__(self, text: NDArray[np.float32], resolution_m: float, config: ValueConfig) -> None:
        self._text = text / max(float(np.linalg.norm(text)), 1e-9)
        self._r = resolution_m
        self._config = config
        self._row0 = self._col0 = 0
        self._cells = np.zeros((2, 2, 0, 0), np.float32)  # robot or surveillance; value or weight

    def add(self, view: SeenView) -> None:
        if view.embedding.shape != self._text.shape:  # another backend's: it says nothing about this text
            return
        score = float(view.embedding.astype(np.float32) @ self._text)
        r = self._r
        x_min, y_min, x_max, y_max = extent(view.reach_m)
        row0, col0 = math.floor((view.y_m + y_min) / r), math.floor((view.x_m + x_min) / r)
        rows, cols = math.floor((view.y_m + y_max) / r) + 1 - row0, math.floor((view.x_m + x_max) / r) + 1 - col0
        self._grow(row0, col0, row0 + rows, col0 + cols)
        part = self._cells[
            :, :, row0 - self._row0 : row0 - self._row0 + rows, col0 - self._col0 : col0 - self._col0 + cols
        ]
        azimuths = sweep(view.reach_m.astype(np.float32), view.x_m, view.y_m, r, row0, col0, rows, cols)
        rule = ("average", "confidence", "latest").index(self._config.fusion)
        # only eq. 2 keeps robot and surveillance apart
        _fuse(
            part[0 if view.is_robot or rule else 1], azimuths, score, rule,
            cone(view.axis_rad, view.half_fov_rad, self._config.min_confidence),
        )  # fmt: skip

    def on(self, grid: Grid) -> NDArray[np.float32]:
        out = np.full(grid.shape, np.nan, np.float32)
        top = self._row0 - round(grid.origin_y_m / self._r)
        left = self._col0 - round(grid.origin_x_m / self._r)
        value = self._joint()
        rows = slice(max(0, -top), max(0, min(value.shape[0], grid.rows - top)))
        cols = slice(max(0, -left), max(0, min(value.shape[1], grid.cols - left)))
        out[rows.start + top : rows.stop + top, cols.start + left : cols.stop + left] = value[rows, cols]
        return out

    def _joint(self) -> NDArray[np.float32]:
        (robot, n_robot), (surveillance, n_surveillance) = self._cells
        if self._config.fusion != "average":
            return np.where(n_robot > 0, robot, np.nan).astype(np.float32)
        # eq. 2: the mean of both, where both have looked
        n = (n_robot > 0).astype(np.float32) + (n_surveillance > 0)
        with np.errstate(invalid="ignore"):
            return np.asarray((robot + surveillance) / n, np.float32)

    def _grow(self, row0: int, col0: int, row1: int, col1: int) -> None:
        rows, cols = self._cells.shape[2:]
        if rows == 0:
            self._row0, self._col0 = row0, col0
        new_row0, new_col0 = min(row0, self._row0), min(col0, self._col0)
        new_rows = max(row1, self._row0 + rows) - new_row0
        new_cols = max(col1, self._col0 + cols) - new_col0
        if (new_rows, new_cols) == (rows, cols):
            return
        pad = round(4.0 / self._r) if rows else 0  # growing in strides keeps the cost of a view flat
        if new_row0 < self._row0:
            new_row0, new_rows = new_row0 - pad, new_rows + pad
        if new_col0 < self._col0:
            new_col0, new_cols = new_col0 - pad, new_cols + pad
        cells = np.zeros((2, 2, new_rows + pad, new_cols + pad), np.float32)
        top, left = self._row0 - new_row0, self._col0 - new_col0
        cells[:, :, top : top + rows, left : left + cols] = self._cells
        self._cells, self._row0, self._col0 = cells, new_row0, new_col0


def cone(axis_rad: float, half_fov_rad: float, low: float) -> NDArray[np.float32]:
    """VLFM's confidence of each azimuth bin (360,): cos^2 across the field of view, mapped to [low, 1].

    arXiv 2312.03275, sec. IV-B. Half a field of view of 0 means no cone: 1 everywhere.
    """
    if half_fov_rad <= 0:
        return np.ones(AZIMUTHS, np.float32)
    azimuth_rad = (np.arange(AZIMUTHS) + 0.5) * (2 * math.pi / AZIMUTHS)
    angle_rad = np.abs((azimuth_rad - axis_rad + math.pi) % (2 * math.pi) - math.pi)
    across = np.cos(np.minimum(1.0, angle_rad / half_fov_rad) * (math.pi / 2)) ** 2
    return np.asarray(low + (1.0 - low) * across, np.float32)


@njit(cache=True, nogil=True)
def _fuse(layer, azimuths, score, rule, weights):  # type: ignore[no-untyped-def]
    for row in range(azimuths.shape[0]):
        for col in range(azimuths.shape[1]):
            if azimuths[row, col] < 0:
                continue
            value, weight = layer[0, row, col], layer[1, row, col]
            if rule == 0:  # running mean
                layer[1, row, col] = weight + 1.0
                layer[0, row, col] = value + (score - value) / (weight + 1.0)
            elif rule == 1:  # VLFM: the mean weighted by confidence, and the confidence of that mean
                c = weights[azimuths[row, col]]
                layer[0, row, col] = (weight * value + c * score) / (weight + c)
                layer[1, row, col] = (weight * weight + c * c) / (weight + c)
            else:  # the latest
                layer[0, row, col] = score
                layer[1, row, col] = 1.0
