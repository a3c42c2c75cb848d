"""The joint map: every view of robots and cameras, on one map per storey."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.fusion.core.config import FusionConfig
from services.fusion.core.floor_map import FloorMap
from services.fusion.core.objects import ObjectMap
from services.fusion.core.value import ValueMap
from surveilnav.geometry import Grid
from surveilnav.messages.maps import DEFAULT_LAYERS, ObjectRecord
from surveilnav.sensing.views import PosedView, ViewPerception, box_cells


@dataclass(frozen=True, slots=True)
class Integrated:
    """What a view brought: the storey it went to, its points, and its detections that had a place."""

    floor: str
    revision: int
    n_points: int
    n_located: int


@dataclass(frozen=True, slots=True, eq=False)
class _Storey:
    geometry: FloorMap
    value: ValueMap
    objects: ObjectMap


class JointMap:
    """The joint maps of a building. ``revision`` counts the views that they hold."""

    def __init__(self, config: FusionConfig | None = None) -> None:
        self.config = config or FusionConfig()
        self.revision = 0
        self._storeys: dict[str, _Storey] = {}
        self._name_of: dict[str, str] = {}  # what sources call a storey -> what the map calls it

    @property
    def floors(self) -> dict[str, float]:
        """Altitude [m] of each storey that was seen, by id."""
        return {name: s.geometry.z_m for name, s in self._storeys.items()}

    def integrate(self, view: PosedView, perception: ViewPerception | None) -> Integrated:
        """Adds one view. ``perception`` None: no detector looked at it (which is no negative evidence).

        Views of one step go in the order of ``canonical``: occupancy, exploration and cloud don't depend on it, value
        and objects may.

        Raises:
            ValueError: a view that can't be: its pictures, mask or position are wrong. The maps stay as they were.
        """
        _check(view, perception)
        storey = self._storey_of(view)
        # point cloud, obstacle and exploration maps
        try:
            n_points, reach_m = storey.geometry.integrate(view)
        except ValueError:
            self._forget_if_new(storey)
            raise
        self.revision += 1
        storey.geometry.revision = self.revision
        n_located = 0
        if perception is not None:
            # value map
            if perception.image_embedding.size:
                storey.value.add(view, reach_m, perception.image_embedding)
            # object map
            n_located = storey.objects.integrate(view, perception.detections)
        return Integrated(storey.geometry.floor, self.revision, n_points, n_located)

    def _forget_if_new(self, storey: _Storey) -> None:
        """Takes back a storey that only a refused view made."""
        if storey.geometry.revision == 0:
            name = storey.geometry.floor
            self._storeys.pop(name, None)
            self._name_of = {said: known for said, known in self._name_of.items() if known != name}

    def layer(
        self, floor: str, name: str, text_embedding: NDArray[np.floating] | None = None
    ) -> tuple[Grid, NDArray[np.generic]]:
        """A layer of a storey and its frame: occupancy, explored, frontier uint8; value float32; cloud (N, 6) float32.

        Raises:
            KeyError: no such storey or layer. ValueError: value without a text embedding.
        """
        storey = self._named(floor)
        geometry = storey.geometry
        if name == "occupancy":
            return geometry.grid, geometry.occupied()
        if name == "explored":
            return geometry.grid, geometry.explored()
        if name == "frontier":
            return geometry.grid, geometry.frontier()
        if name == "cloud":
            return geometry.grid, geometry.cloud.array()
        if name != "value":
            raise KeyError(f"no layer {name!r}; there are {', '.join(DEFAULT_LAYERS)}")
        if text_embedding is None:
            raise ValueError("the value layer belongs to a target: its text embedding is needed")
        return geometry.grid, storey.value.layer(geometry.grid, text_embedding)

    def objects(self, floor: str) -> list[ObjectRecord]:
        """The objects of a storey. KeyError: no such storey."""
        return self._named(floor).objects.records()

    def floor_revision(self, floor: str) -> int:
        """The revision at which a storey last changed. KeyError: no such storey."""
        return self._named(floor).geometry.revision

    def _named(self, floor: str) -> _Storey:
        try:
            return self._storeys[self._name_of.get(floor, floor)]
        except KeyError:
            known = sorted(self._storeys)
            raise KeyError(f"nothing was seen yet of floor {floor!r}; there are maps of {known}") from None

    def _storey_of(self, view: PosedView) -> _Storey:
        """The storey at the view's estimated floor altitude (tau_z), a new one if there is none."""
        c, z_m = self.config.map, view.floor_z_m
        near = [(abs(s.geometry.z_m - z_m), name) for name, s in self._storeys.items()]
        distance_m, name = min(near, default=(np.inf, ""))
        if distance_m > c.tau_z_m:
            name, k = view.floor, 2
            while name in self._storeys:  # two altitudes under one name: split levels, or a lie
                name, k = f"{view.floor}-{k}", k + 1
            if len(self._storeys) >= c.max_floors:
                raise ValueError(
                    f"a view at altitude {z_m:.1f} m would make more than {c.max_floors} floors (max_floors)"
                )
            x, y, _ = view.T_world_camera[:3, 3]
            self._storeys[name] = _Storey(
                FloorMap(name, z_m, (float(x), float(y)), c), ValueMap(self.config.value),
                ObjectMap(name, c.voxel_m, self.config.objects),
            )  # fmt: skip
        self._name_of.setdefault(view.floor, name)
        return self._storeys[name]


def canonical(views: Iterable[PosedView]) -> list[PosedView]:
    """The one order in which views of a step are integrated: by time, then source, then view."""
    return sorted(views, key=lambda v: (v.stamp_ns, v.source, v.view, v.seq))


def _check(view: PosedView, perception: ViewPerception | None) -> None:
    """Everything that a remote could get wrong, before anything is changed."""
    size = view.camera.height_px, view.camera.width_px
    if view.depth_m.shape != size or view.rgb.shape != (*size, 3) or view.rgb.dtype != np.uint8:
        raise ValueError(f"a view of {size} pixels came with depth {view.depth_m.shape} and colour {view.rgb.shape}")
    if not np.isfinite(view.T_world_camera).all() or not np.isfinite(view.mounting_offset_m):
        raise ValueError("a view's pose and mounting offset must be finite")
    for d in perception.detections if perception else ():
        if not np.isfinite([d.score, *d.box_px]).all() or not np.isfinite(d.embedding).all():
            raise ValueError(f"a detection of {d.label!r} has a score, box or embedding that isn't finite")
        x0, y0, x1, y1 = box_cells(d.box_px, view.camera.width_px, view.camera.height_px)
        if d.mask is not None and d.mask.shape != (y1 - y0, x1 - x0):
            raise ValueError(f"a mask of {d.mask.shape} came with a box of {(y1 - y0, x1 - x0)} pixels")
    if perception is not None and not np.isfinite(perception.image_embedding).all():
        raise ValueError("an image embedding must be finite")
