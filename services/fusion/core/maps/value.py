"""The joint value map: how well the pictures that show a place match the target (eq. 2).

Of each view, its image embedding and its ranges by azimuth are kept. They are scored only when somebody names a target, so a new
target gets a value map of everything that was ever seen, without another byte from a camera. A layer depends only on
the views that are kept and on their order: one that was kept up to date since the first view equals one that is built now.

A view's weight halves with each half-life of its age behind the newest view. All rules of fusion are homogeneous in the weights,
so instead of lowering the weights of all old views, each new view gets a higher one, and a layer is rescaled now and then. That
keeps the cost of a view constant.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import islice
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.geometry import Grid
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core.config import ValueConfig
from surveilnav.services.fusion.core.maps.projection import AZIMUTHS, azimuth_bins, camera_position, covered_box

_STEEP_RAD = math.radians(60)  # a view that looks down more steeply has no meaningful azimuth
_RESCALE_HALF_LIVES = 32  # after which a layer's weights are scaled back
_MIN_WEIGHT = 2.0**-100  # of any view, however old, since its cells have been seen


@dataclass(frozen=True, slots=True, eq=False)
class EmbeddedView:
    """What the value map keeps of a view (2 to 4 kB).

    Attributes:
        stamp_ns: when it was taken; 0 if neither it nor any view before it had a stamp.
        x_m, y_m: position of the camera [m, world].
        ranges_m: (360, 2), by azimuth (``projection.azimuth_ranges``).
        axis_rad: azimuth of the optical axis.
        half_fov_rad: half of the horizontal field of view; 0: the same weight at all azimuths.
        embedding: (D,), unit length.
    """

    is_robot: bool
    stamp_ns: int
    x_m: float
    y_m: float
    ranges_m: NDArray[np.float16]
    axis_rad: float
    half_fov_rad: float
    embedding: NDArray[np.float16]
    embedding_model: str = ""

    @classmethod
    def from_view(
        cls,
        view: PosedView,
        ranges_m: NDArray[np.float32],
        embedding: NDArray[np.float32],
        stamp_ns: int,
        embedding_model: str = "",
    ) -> EmbeddedView:
        """What is kept of a view; see the attributes. ``stamp_ns`` may differ from that of the view."""
        x, y, _ = camera_position(view.T_world_camera)
        forward = view.T_world_camera[:3, 2]
        steep = abs(math.asin(max(-1.0, min(1.0, float(forward[2]))))) > _STEEP_RAD
        return cls(
            view.is_robot,
            stamp_ns,
            float(x),
            float(y),
            ranges_m.astype(np.float16),
            math.atan2(forward[1], forward[0]),
            0.0 if steep else view.camera.hfov_rad / 2,
            embedding.astype(np.float16),
            embedding_model,
        )


class ValueMap:
    """Keeps the embeddings of a floor's views, and value layers of the most recent targets up to date with them."""

    def __init__(self, config: ValueConfig) -> None:
        self._config = config
        self._views: OrderedDict[tuple[str, int, int], EmbeddedView] = OrderedDict()
        self._newest_ns = 0
        self._layers: OrderedDict[tuple[str, bytes], _Layer] = OrderedDict()
        self._epoch = 0  # changes when views are removed, which invalidates all layers

    def __len__(self) -> int:
        return len(self._views)

    def add(
        self,
        view: PosedView,
        embedding: NDArray[np.float32],
        embedding_model: str = "",
        ranges_m: NDArray[np.float32] | None = None,
    ) -> bool:
        """Adds the embedding (D,) of a view.

        A camera's view replaces its earlier picture. A robot's views are all kept, up to a limit. A view without a stamp (0)
        counts as taken with the newest view before it, or with the first one after it that has a stamp.

        Args:
            ranges_m: (360, 2), the view's ranges by azimuth. None: the map has this picture already, and it was perceived
                again. Then only an embedding by another model changes anything.

        Returns:
            Whether the map has changed.
        """
        key = (view.source, view.view, view.seq if view.is_robot else 0)
        former = self._views.get(key)
        if ranges_m is None:
            if former is None or former.embedding_model == embedding_model or not embedding.size:
                return False
            self._views[key] = replace(former, embedding=embedding.astype(np.float16), embedding_model=embedding_model)
            self._invalidate_layers()
            return True
        if self._views.pop(key, None) is not None:
            self._invalidate_layers()
        self._newest_ns = max(self._newest_ns, view.stamp_ns)
        stamp_ns = view.stamp_ns or self._newest_ns
        seen = self._views[key] = EmbeddedView.from_view(view, ranges_m, embedding, stamp_ns, embedding_model)
        for layer in self._layers.values():
            layer.add(seen)
        if len(self._views) > self._config.max_views:
            self._forget_oldest()
        return True

    def views_left_out(self, embedding_model: str) -> int:
        """The number of kept views that were embedded by another model, and say nothing about this model's texts."""
        return sum(view.embedding_model != embedding_model for view in self._views.values())

    def pending(
        self, text_embedding: NDArray[np.floating], resolution_m: float, embedding_model: str = ""
    ) -> PendingLayer | None:
        """The layer of a new target, to be built while others use the map and then passed to ``adopt``; None if there is one."""
        layer = _Layer(text_embedding, embedding_model, resolution_m, self._config)
        if layer.key in self._layers:
            return None
        return PendingLayer(layer, list(self._views.values()), self._epoch)

    def adopt(self, built: PendingLayer) -> None:
        """Adds the views that came since to a layer that was built, and keeps it; drops it if views were removed since."""
        if built.epoch != self._epoch:
            return
        for view in islice(self._views.values(), len(built.views), None):
            built.layer.add(view)
        self._cache(built.layer)

    def layer(self, grid: Grid, text_embedding: NDArray[np.floating], embedding_model: str = "") -> NDArray[np.float32]:
        """The value map (rows, cols) float32 on ``grid`` for a target's text embedding (D,).

        NaN in cells that no view shows, or only views that another model has embedded.
        """
        new = _Layer(text_embedding, embedding_model, grid.resolution_m, self._config)
        layer = self._layers.get(new.key)
        if layer is None:
            layer = new
            for view in self._views.values():
                layer.add(view)
        self._cache(layer)
        return layer.on_grid(grid)

    def _cache(self, layer: _Layer) -> None:
        self._layers[layer.key] = layer
        self._layers.move_to_end(layer.key)
        while len(self._layers) > self._config.max_targets:
            self._layers.popitem(last=False)

    def _invalidate_layers(self) -> None:
        """Drops all layers, since what a removed view contributed can't be taken out of them."""
        self._layers.clear()
        self._epoch += 1

    def _forget_oldest(self) -> None:
        """Removes an eighth of the views, robots' oldest first. So many at once, so that layers are seldom built anew."""
        oldest = sorted(self._views, key=lambda key: not self._views[key].is_robot)  # stable: in order of arrival
        for key in oldest[: max(1, self._config.max_views // 8)]:
            del self._views[key]
        self._invalidate_layers()

    def state(self) -> dict[str, Any]:
        """Everything as plain arrays and values, for ``from_state``. Layers are left out, since they follow from the views."""
        return {"newest_ns": self._newest_ns, "views": [[*key, view] for key, view in self._views.items()]}

    @classmethod
    def from_state(cls, state: dict[str, Any], config: ValueConfig) -> ValueMap:
        value = cls(config)
        value._newest_ns = state["newest_ns"]
        for source, view, seq, seen in state["views"]:
            value._views[source, view, seq] = EmbeddedView(**seen)
        return value


@dataclass(frozen=True, slots=True, eq=False)
class PendingLayer:
    """A value layer that is built beside the map, from a copy of its list of views."""

    layer: _Layer
    views: list[EmbeddedView]
    epoch: int

    def build(self) -> PendingLayer:
        """Adds the views to the layer."""
        for view in self.views:
            self.layer.add(view)
        return self


class _Layer:
    """The value layer of one target. It grows as needed."""

    def __init__(
        self, text_embedding: NDArray[np.floating], embedding_model: str, resolution_m: float, config: ValueConfig
    ) -> None:
        text = np.asarray(text_embedding, np.float32)
        self.key = embedding_model, text.tobytes()
        self._embedding_model = embedding_model
        self._unit = text / max(float(np.linalg.norm(text)), 1e-9)
        self._resolution_m = resolution_m
        self._config = config
        self._row0 = self._col0 = 0
        self._reference_ns = 0  # a view of this time has weight 1
        # (robot, surveillance) x (value, weight, weight of the newest view) x rows x columns
        self._cells = np.zeros((2, 3, 0, 0), np.float32)

    def add(self, view: EmbeddedView) -> None:
        """Fuses the cosine of a view and the target (the paper's ``cos(f_v, f_t)``) into the cells that the view shows."""
        if (view.embedding_model, view.embedding.shape) != (self._embedding_model, self._unit.shape):
            return
        score = float(view.embedding.astype(np.float32) @ self._unit)
        r = self._resolution_m
        x_min, y_min, x_max, y_max = covered_box(view.ranges_m)
        row0, col0 = math.floor((view.y_m + y_min) / r), math.floor((view.x_m + x_min) / r)
        rows, cols = math.floor((view.y_m + y_max) / r) + 1 - row0, math.floor((view.x_m + x_max) / r) + 1 - col0
        self._grow(row0, col0, row0 + rows, col0 + cols)
        part = self._cells[
            :, :, row0 - self._row0 : row0 - self._row0 + rows, col0 - self._col0 : col0 - self._col0 + cols
        ]
        azimuths = azimuth_bins(view.ranges_m.astype(np.float32), view.x_m, view.y_m, r, row0, col0, rows, cols)
        rule = ("average", "confidence", "latest").index(self._config.fusion)
        # only eq. 2 keeps robot and surveillance separate
        _fuse(
            part[0 if view.is_robot or rule else 1],
            azimuths,
            score,
            rule,
            view_confidence(view.axis_rad, view.half_fov_rad, self._config.min_confidence),
            self._age_weight(view.stamp_ns),
        )

    def _age_weight(self, stamp_ns: int) -> float:
        """The weight of a view by its time: doubled for each half-life after ``_reference_ns``. May rescale the layer."""
        half_life_ns = self._config.half_life_s * 1e9
        if half_life_ns == 0 or stamp_ns == 0:  # of unknown age, which counts as that of the first view with a stamp
            return 1.0
        if not self._reference_ns:
            self._reference_ns = stamp_ns
        half_lives = (stamp_ns - self._reference_ns) / half_life_ns
        if half_lives > _RESCALE_HALF_LIVES:
            whole = math.floor(half_lives)
            _scale(self._cells, 2.0 ** -min(whole, 200), _MIN_WEIGHT)
            self._reference_ns += round(whole * half_life_ns)
            half_lives = (stamp_ns - self._reference_ns) / half_life_ns
        return max(math.pow(2.0, max(half_lives, -200.0)), _MIN_WEIGHT)

    def on_grid(self, grid: Grid) -> NDArray[np.float32]:
        """The layer (rows, cols) float32, cropped or padded to ``grid``; NaN where nothing was seen."""
        out = np.full(grid.shape, np.nan, np.float32)
        top = self._row0 - round(grid.origin_y_m / self._resolution_m)
        left = self._col0 - round(grid.origin_x_m / self._resolution_m)
        value = self._joint()
        rows, cols = (
            slice(max(0, -first), max(0, -first, min(mine, theirs - first)))
            for first, mine, theirs in ((top, value.shape[0], grid.rows), (left, value.shape[1], grid.cols))
        )
        out[rows.start + top : rows.stop + top, cols.start + left : cols.stop + left] = value[rows, cols]
        return out

    def _joint(self) -> NDArray[np.float32]:
        """The values of robot and surveillance fused (eq. 2)."""
        (robot, n_robot, w_robot), (surveillance, _, w_surveillance) = self._cells
        if self._config.fusion != "average":
            return np.where(n_robot > 0, robot, np.nan).astype(np.float32)
        # eq. 2: the mean of both where both have looked, weighted by the ages of their newest views
        with np.errstate(invalid="ignore"):
            share = w_robot / (w_robot + w_surveillance)
        return np.asarray(share * robot + (1 - share) * surveillance, np.float32)

    def _grow(self, row0: int, col0: int, row1: int, col1: int) -> None:
        rows, cols = self._cells.shape[2:]
        if rows == 0:
            self._row0, self._col0 = row0, col0
        new_row0, new_col0 = min(row0, self._row0), min(col0, self._col0)
        new_rows = max(row1, self._row0 + rows) - new_row0
        new_cols = max(col1, self._col0 + cols) - new_col0
        if (new_rows, new_cols) == (rows, cols):
            return
        pad = round(4.0 / self._resolution_m) if rows else 0  # growing in strides keeps the cost of a view constant
        if new_row0 < self._row0:
            new_row0, new_rows = new_row0 - pad, new_rows + pad
        if new_col0 < self._col0:
            new_col0, new_cols = new_col0 - pad, new_cols + pad
        cells = np.zeros((2, 3, new_rows + pad, new_cols + pad), np.float32)
        top, left = self._row0 - new_row0, self._col0 - new_col0
        cells[:, :, top : top + rows, left : left + cols] = self._cells
        self._cells, self._row0, self._col0 = cells, new_row0, new_col0


@lru_cache(maxsize=1024)  # there are few directions: most cameras don't turn, and robots turn in steps
def view_confidence(axis_rad: float, half_fov_rad: float, low: float) -> NDArray[np.float32]:
    """VLFM's confidence by azimuth bin (360,): cos^2 across the field of view, mapped to [low, 1].

    arXiv 2312.03275, section IV-B. ``half_fov_rad`` 0 means 1 everywhere.
    """
    if half_fov_rad <= 0:
        return np.ones(AZIMUTHS, np.float32)
    azimuth_rad = (np.arange(AZIMUTHS) + 0.5) * (2 * math.pi / AZIMUTHS)
    angle_rad = np.abs((azimuth_rad - axis_rad + math.pi) % (2 * math.pi) - math.pi)
    across = np.cos(np.minimum(1.0, angle_rad / half_fov_rad) * (math.pi / 2)) ** 2
    return np.asarray(low + (1.0 - low) * across, np.float32)


@njit(cache=True, nogil=True)
def _fuse(layer, azimuths, score, rule, confidences, age_weight):  # type: ignore[no-untyped-def]
    for row in range(azimuths.shape[0]):
        for col in range(azimuths.shape[1]):
            if azimuths[row, col] < 0:
                continue
            value, weight = np.float64(layer[0, row, col]), np.float64(layer[1, row, col])
            if rule == 0:  # running mean
                layer[1, row, col] = weight + age_weight
                layer[0, row, col] = value + (score - value) * (age_weight / (weight + age_weight))
                layer[2, row, col] = max(layer[2, row, col], age_weight)
            elif rule == 1:  # VLFM: the mean weighted by confidence, and the confidence in that mean
                c = age_weight * confidences[azimuths[row, col]]
                layer[0, row, col] = (weight * value + c * score) / (weight + c)
                layer[1, row, col] = (weight * weight + c * c) / (weight + c)
            else:  # the latest
                layer[0, row, col] = score
                layer[1, row, col] = 1.0


@njit(cache=True, nogil=True)
def _scale(cells, factor, min_weight):  # type: ignore[no-untyped-def]
    for kind in range(2):
        for k in range(1, 3):
            for row in range(cells.shape[2]):
                for col in range(cells.shape[3]):
                    if cells[kind, k, row, col] > 0:
                        cells[kind, k, row, col] = max(cells[kind, k, row, col] * factor, min_weight)
