"""The joint value map: how much the pictures that show a place sound like the target (eq. 2).

What is kept of a view is its image embedding and its reach; scores come in only when somebody names a target, so a
new target gets its map from everything seen so far without one new byte from a camera. A layer follows from the views
kept, in their order, and from nothing else: one kept up to date since the first view equals one made now.

A view's weight halves with every half-life of its age behind the newest. Every rule is homogeneous in the weights, so
instead of old weights sinking new ones rise, and a layer is rescaled now and then: the cost of a view stays flat.
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
from surveilnav.services.fusion.core.maps.projection import AZIMUTHS, azimuth_bins, camera_position, extent

_STEEP = math.radians(60)  # a camera that looks down more steeply has no azimuth worth a cone
_RESCALE = 32  # half-lives that a layer's weights may rise before they are scaled back
_FAINTEST = 2.0**-100  # weight of what was seen an eternity ago: it still was seen


@dataclass(frozen=True, slots=True, eq=False)
class SeenView:
    """What the value map keeps of a view (2 to 4 kB). ``stamp_ns`` 0: no view before it had one either."""

    is_robot: bool
    stamp_ns: int
    x_m: float
    y_m: float
    reach_m: NDArray[np.float16]  # (360, 2)
    axis_rad: float
    half_fov_rad: float  # 0: no cone, the same weight everywhere
    embedding: NDArray[np.float16]
    embedding_model: str = ""

    @classmethod
    def from_view(
        cls,
        view: PosedView,
        reach_m: NDArray[np.float32],
        embedding: NDArray[np.float32],
        stamp_ns: int,
        embedding_model: str = "",
    ) -> SeenView:
        """``reach_m`` (360, 2) from ``projection.reach``; ``embedding`` (D,) unit length."""
        x, y, _ = camera_position(view.T_world_camera)
        forward = view.T_world_camera[:3, 2]
        steep = abs(math.asin(max(-1.0, min(1.0, float(forward[2]))))) > _STEEP
        return cls(
            view.is_robot,
            stamp_ns,
            float(x),
            float(y),
            reach_m.astype(np.float16),
            math.atan2(forward[1], forward[0]),
            0.0 if steep else view.camera.hfov_rad / 2,
            embedding.astype(np.float16),
            embedding_model,
        )


class ValueMap:
    """Keeps views of a floor, and the value layers of the targets asked for last, up to date."""

    def __init__(self, config: ValueConfig) -> None:
        self._config = config
        self._views: OrderedDict[tuple[str, int, int], SeenView] = OrderedDict()
        self._newest_ns = 0
        self._layers: OrderedDict[tuple[str, bytes], _Layer] = OrderedDict()
        self._epoch = 0  # changes when views go: layers made before are worth nothing

    def __len__(self) -> int:
        return len(self._views)

    def add(
        self,
        view: PosedView,
        embedding: NDArray[np.float32],
        embedding_model: str = "",
        reach_m: NDArray[np.float32] | None = None,
    ) -> bool:
        """Adds a view's embedding (D,); returns whether that changed the map.

        A camera's view replaces its earlier picture; a robot's views are all kept, up to a limit. A view without a stamp
        (0) counts as new as the newest before it, or as the first after it that has one.

        Args:
            reach_m: (360, 2) how far the view sees by azimuth. None: the picture was added before and is perceived
                again; its reach is known, and only the embedding of another model changes anything.
        """
        key = (view.source, view.view, view.seq if view.is_robot else 0)
        former = self._views.get(key)
        if reach_m is None:
            if former is None or former.embedding_model == embedding_model or not embedding.size:
                return False
            self._views[key] = replace(former, embedding=embedding.astype(np.float16), embedding_model=embedding_model)
            self._start_anew()
            return True
        if self._views.pop(key, None) is not None:
            self._start_anew()
        self._newest_ns = max(self._newest_ns, view.stamp_ns)
        stamp_ns = view.stamp_ns or self._newest_ns
        seen = self._views[key] = SeenView.from_view(view, reach_m, embedding, stamp_ns, embedding_model)
        for layer in self._layers.values():
            layer.add(seen)
        if len(self._views) > self._config.max_views:
            self._forget_oldest()
        return True

    def left_out(self, embedding_model: str) -> int:
        """How many of the views kept say nothing about that model's texts: another model looked at them."""
        return sum(view.embedding_model != embedding_model for view in self._views.values())

    def pending(
        self, text_embedding: NDArray[np.floating], resolution_m: float, embedding_model: str = ""
    ) -> PendingLayer | None:
        """A layer that isn't kept yet, to be built while others use the map, then given to ``adopt``; None if it is."""
        layer = _Layer(text_embedding, embedding_model, resolution_m, self._config)
        if layer.key in self._layers:
            return None
        return PendingLayer(layer, list(self._views.values()), self._epoch)

    def adopt(self, built: PendingLayer) -> None:
        """Keeps a layer built meanwhile, with the views that came since; useless and dropped if some went."""
        if built.epoch != self._epoch:
            return
        for view in islice(self._views.values(), len(built.views), None):
            built.layer.add(view)
        self._keep(built.layer)

    def layer(self, grid: Grid, text_embedding: NDArray[np.floating], embedding_model: str = "") -> NDArray[np.float32]:
        """The value map (rows, cols) float32 on ``grid`` for a text embedding (D,) of a model; NaN where nothing was seen
        by that model."""
        new = _Layer(text_embedding, embedding_model, grid.resolution_m, self._config)
        layer = self._layers.get(new.key)
        if layer is None:
            layer = new
            for view in self._views.values():
                layer.add(view)
        self._keep(layer)
        return layer.on(grid)

    def _keep(self, layer: _Layer) -> None:
        self._layers[layer.key] = layer
        self._layers.move_to_end(layer.key)
        while len(self._layers) > self._config.max_targets:
            self._layers.popitem(last=False)

    def _start_anew(self) -> None:
        """What a view that goes contributed can't be taken out again: layers start anew."""
        self._layers.clear()
        self._epoch += 1

    def _forget_oldest(self) -> None:
        """Drops an eighth at once, robots' first: layers start anew seldom."""
        oldest = sorted(self._views, key=lambda key: not self._views[key].is_robot)  # stable: in order of arrival
        for key in oldest[: max(1, self._config.max_views // 8)]:
            del self._views[key]
        self._start_anew()

    def state(self) -> dict[str, Any]:
        """All of it, as plain arrays and values, for ``from_state``; layers follow from the views."""
        return {"newest_ns": self._newest_ns, "views": [[*key, view] for key, view in self._views.items()]}

    @classmethod
    def from_state(cls, state: dict[str, Any], config: ValueConfig) -> ValueMap:
        """The value map that ``state`` describes."""
        value = cls(config)
        value._newest_ns = state["newest_ns"]
        for source, view, seq, seen in state["views"]:
            value._views[source, view, seq] = SeenView(**seen)
        return value


@dataclass(frozen=True, slots=True, eq=False)
class PendingLayer:
    """A value layer to be built off the map: it shares nothing that changes."""

    layer: _Layer
    views: list[SeenView]
    epoch: int

    def build(self) -> PendingLayer:
        """Adds the views."""
        for view in self.views:
            self.layer.add(view)
        return self


class _Layer:
    """The value layer of one target; grows as needed."""

    def __init__(
        self, text_embedding: NDArray[np.floating], embedding_model: str, resolution_m: float, config: ValueConfig
    ) -> None:
        text = np.asarray(text_embedding, np.float32)
        self.key = embedding_model, text.tobytes()
        self._embedding_model = embedding_model
        self._unit = text / max(float(np.linalg.norm(text)), 1e-9)
        self._r = resolution_m
        self._config = config
        self._row0 = self._col0 = 0
        self._since_ns = 0  # when a view weighs 1
        self._cells = np.zeros((2, 3, 0, 0), np.float32)  # robot or surveillance; value, weight, weight of the newest

    def add(self, view: SeenView) -> None:
        """Projects the cosine of a view and the target (the paper's ``cos(f_v, f_t)``) onto the cells that it reaches."""
        if (view.embedding_model, view.embedding.shape) != (self._embedding_model, self._unit.shape):
            return
        score = float(view.embedding.astype(np.float32) @ self._unit)
        r = self._r
        x_min, y_min, x_max, y_max = extent(view.reach_m)
        row0, col0 = math.floor((view.y_m + y_min) / r), math.floor((view.x_m + x_min) / r)
        rows, cols = math.floor((view.y_m + y_max) / r) + 1 - row0, math.floor((view.x_m + x_max) / r) + 1 - col0
        self._grow(row0, col0, row0 + rows, col0 + cols)
        part = self._cells[
            :, :, row0 - self._row0 : row0 - self._row0 + rows, col0 - self._col0 : col0 - self._col0 + cols
        ]
        azimuths = azimuth_bins(view.reach_m.astype(np.float32), view.x_m, view.y_m, r, row0, col0, rows, cols)
        rule = ("average", "confidence", "latest").index(self._config.fusion)
        # only eq. 2 keeps robot and surveillance apart
        _fuse(
            part[0 if view.is_robot or rule else 1],
            azimuths,
            score,
            rule,
            cone(view.axis_rad, view.half_fov_rad, self._config.min_confidence),
            self._gain(view.stamp_ns),
        )

    def _gain(self, stamp_ns: int) -> float:
        """Weight of a view of that time: 2 for each half-life after ``_since_ns``. May scale all others back."""
        half_life_ns = self._config.half_life_s * 1e9
        if half_life_ns == 0 or stamp_ns == 0:  # nobody knows its age: as new as the first that has one
            return 1.0
        if not self._since_ns:
            self._since_ns = stamp_ns
        halves = (stamp_ns - self._since_ns) / half_life_ns
        if halves > _RESCALE:
            whole = math.floor(halves)
            _scale(self._cells, 2.0 ** -min(whole, 200), _FAINTEST)
            self._since_ns += round(whole * half_life_ns)
            halves = (stamp_ns - self._since_ns) / half_life_ns
        return max(math.pow(2.0, max(halves, -200.0)), _FAINTEST)

    def on(self, grid: Grid) -> NDArray[np.float32]:
        """The layer (rows, cols) float32 on ``grid``; NaN where nothing was seen."""
        out = np.full(grid.shape, np.nan, np.float32)
        top = self._row0 - round(grid.origin_y_m / self._r)
        left = self._col0 - round(grid.origin_x_m / self._r)
        value = self._joint()
        rows, cols = (
            slice(max(0, -first), max(0, -first, min(mine, theirs - first)))
            for first, mine, theirs in ((top, value.shape[0], grid.rows), (left, value.shape[1], grid.cols))
        )
        out[rows.start + top : rows.stop + top, cols.start + left : cols.stop + left] = value[rows, cols]
        return out

    def _joint(self) -> NDArray[np.float32]:
        """Robot and surveillance together (eq. 2)."""
        (robot, n_robot, w_robot), (surveillance, _, w_surveillance) = self._cells
        if self._config.fusion != "average":
            return np.where(n_robot > 0, robot, np.nan).astype(np.float32)
        # eq. 2: the mean of both, where both have looked; of two ages, weighted by that of the last look
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
        pad = round(4.0 / self._r) if rows else 0  # growing in strides keeps the cost of a view flat
        if new_row0 < self._row0:
            new_row0, new_rows = new_row0 - pad, new_rows + pad
        if new_col0 < self._col0:
            new_col0, new_cols = new_col0 - pad, new_cols + pad
        cells = np.zeros((2, 3, new_rows + pad, new_cols + pad), np.float32)
        top, left = self._row0 - new_row0, self._col0 - new_col0
        cells[:, :, top : top + rows, left : left + cols] = self._cells
        self._cells, self._row0, self._col0 = cells, new_row0, new_col0


@lru_cache(maxsize=1024)  # few cameras turn, and robots turn in steps
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
def _fuse(layer, azimuths, score, rule, weights, gain):  # type: ignore[no-untyped-def]
    for row in range(azimuths.shape[0]):
        for col in range(azimuths.shape[1]):
            if azimuths[row, col] < 0:
                continue
            value, weight = np.float64(layer[0, row, col]), np.float64(layer[1, row, col])
            if rule == 0:  # running mean
                layer[1, row, col] = weight + gain
                layer[0, row, col] = value + (score - value) * (gain / (weight + gain))
                layer[2, row, col] = max(layer[2, row, col], gain)
            elif rule == 1:  # VLFM: the mean weighted by confidence, and the confidence of that mean
                c = gain * weights[azimuths[row, col]]
                layer[0, row, col] = (weight * value + c * score) / (weight + c)
                layer[1, row, col] = (weight * weight + c * c) / (weight + c)
            else:  # the latest
                layer[0, row, col] = score
                layer[1, row, col] = 1.0


@njit(cache=True, nogil=True)
def _scale(cells, factor, faintest):  # type: ignore[no-untyped-def]
    for kind in range(2):
        for k in range(1, 3):
            for row in range(cells.shape[2]):
                for col in range(cells.shape[3]):
                    if cells[kind, k, row, col] > 0:
                        cells[kind, k, row, col] = max(cells[kind, k, row, col] * factor, faintest)
