"""The joint map: every view of robots and cameras, on one map per storey."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.fusion.core.config import FusionConfig
from services.fusion.core.floor_map import FloorMap
from services.fusion.core.guard import Guard, ViewError, check
from services.fusion.core.objects import Happened, ObjectMap
from services.fusion.core.value import PendingLayer, ValueMap
from surveilnav.geometry import Grid
from surveilnav.messages.maps import DEFAULT_LAYERS, ObjectRecord
from surveilnav.sensing.views import PosedView, ViewPerception

_MAX_NAMES = 256  # of storeys: a robot may say what it likes
_LEVEL_M = 0.1  # of altitude: within this a robot stays on one level


@dataclass(frozen=True, slots=True)
class Integrated:
    """What a view brought: the storey it went to, its points, its detections that had a place, and news of objects."""

    floor: str
    revision: int
    n_points: int
    n_located: int
    events: tuple[Happened, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class _Storey:
    geometry: FloorMap
    value: ValueMap
    objects: ObjectMap


@dataclass(frozen=True, slots=True)
class _Walk:
    """A robot's last step, and the level that it has been on since: what tells a storey from a stair."""

    storey: str
    z_m: float
    level_m: tuple[float, float, float]  # where the level began, its altitude last
    views: int

    def on(self, storey: str, x_m: float, y_m: float, z_m: float) -> _Walk:
        """The walk one view later."""
        if abs(z_m - self.level_m[2]) <= _LEVEL_M:
            return _Walk(storey, z_m, self.level_m, self.views + 1)
        return _Walk(storey, z_m, (x_m, y_m, z_m), 1)


class JointMap:
    """The joint maps of a building. ``revision`` counts the views that they hold."""

    def __init__(self, config: FusionConfig | None = None) -> None:
        self.config = config or FusionConfig()
        self.revision = 0
        self.guard = Guard(self.config.guard)
        self._storeys: dict[str, _Storey] = {}
        self._name_of: dict[str, str] = {}  # what sources call a storey -> what the map calls it
        self._walks: dict[str, _Walk] = {}  # by robot

    @property
    def floors(self) -> dict[str, float]:
        """Altitude [m] of each storey that was seen, by id."""
        return {name: s.geometry.z_m for name, s in self._storeys.items()}

    def accept(self, view: PosedView, perception: ViewPerception | None) -> Integrated | None:
        """Adds a view that came from outside; None if the maps hold it already.

        Raises:
            ViewError: the view can't be, by itself or after the last one of its source. The maps stay as they were.
        """
        check(view, perception)
        if not self.guard.admit(view, perception):
            return None
        done = self._integrate(view, perception)
        self.guard.note(view, perception)
        return done

    def integrate(self, view: PosedView, perception: ViewPerception | None) -> Integrated:
        """Adds one view, whatever came before it. ``perception`` None: no detector looked (no negative evidence).

        Views of one step go in the order of ``canonical``: occupancy, exploration and cloud don't depend on it, value
        and objects may.

        Raises:
            ViewError: a view that can't be: its pictures, mask or position are wrong. The maps stay as they were.
        """
        check(view, perception)
        return self._integrate(view, perception)

    def _integrate(self, view: PosedView, perception: ViewPerception | None) -> Integrated:
        storey = self._storey_of(view)
        # point cloud, obstacle and exploration maps
        try:
            n_points, reach_m = storey.geometry.integrate(view)
        except ValueError as error:
            self._forget_if_new(storey)
            raise ViewError("out_of_map", str(error)) from error
        self._remember_name(view, storey)
        self.revision += 1
        storey.geometry.revision = self.revision
        self._walk_on(view, storey.geometry.floor)
        n_located = 0
        if perception is not None:
            # value map
            if perception.image_embedding.size:
                storey.value.add(view, reach_m, perception.image_embedding)
            # object map
            n_located = storey.objects.integrate(view, perception.detections)
        return Integrated(storey.geometry.floor, self.revision, n_points, n_located, tuple(storey.objects.take_news()))

    def _forget_if_new(self, storey: _Storey) -> None:
        """Takes back a storey that only a refused view made."""
        if storey.geometry.revision == 0:
            self._storeys.pop(storey.geometry.floor, None)

    def _remember_name(self, view: PosedView, storey: _Storey) -> None:
        """What the source of a view that was taken calls its storey; on a stair its name means nothing yet."""
        name = storey.geometry.floor
        if storey.geometry.revision == 0:
            self._name_of[name] = name  # whatever was called so before
        if self.storey_at(view.floor_z_m) == name and len(self._name_of) < _MAX_NAMES:
            self._name_of.setdefault(view.floor, name)

    def layer(
        self, floor: str, name: str, text_embedding: NDArray[np.floating] | None = None
    ) -> tuple[Grid, NDArray[np.generic]]:
        """A layer of a storey and its frame: occupancy, explored, frontier uint8; value float32; cloud (N, 6) float32;
        provenance (N, 3) int64, line by line with the cloud: number in ``source_sets``, first and last seen [ns].

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
        if name == "provenance":
            sources, first_ns, last_ns, _ = geometry.cloud.provenance()
            return geometry.grid, np.stack([sources, first_ns, last_ns], axis=-1)
        if name != "value":
            raise KeyError(f"no layer {name!r}; there are {', '.join(DEFAULT_LAYERS)}")
        if text_embedding is None:
            raise ValueError("the value layer belongs to a target: its text embedding is needed")
        return geometry.grid, storey.value.layer(geometry.grid, text_embedding)

    def knows(self, floor: str) -> bool:
        """Whether there is a map of a storey."""
        return self._name_of.get(floor, floor) in self._storeys

    def pending_value(self, floor: str, text_embedding: NDArray[np.floating]) -> PendingLayer | None:
        """A new target's value layer, to be built while the maps go on; None if it is kept. KeyError: no such storey."""
        storey = self._named(floor)
        return storey.value.pending(text_embedding, storey.geometry.grid.resolution_m)

    def adopt_value(self, floor: str, built: PendingLayer) -> None:
        """Keeps a pending layer that was built. KeyError: no such storey."""
        self._named(floor).value.adopt(built)

    def objects(self, floor: str) -> list[ObjectRecord]:
        """The objects of a storey. KeyError: no such storey."""
        return self._named(floor).objects.records()

    def source_sets(self, floor: str) -> list[list[str]]:
        """The sets of sources that the layer ``provenance`` of a storey counts by. KeyError: no such storey."""
        return self._named(floor).geometry.cloud.source_sets()

    def floor_revision(self, floor: str) -> int:
        """The revision at which a storey last changed. KeyError: no such storey."""
        return self._named(floor).geometry.revision

    def _named(self, floor: str) -> _Storey:
        try:
            return self._storeys[self._name_of.get(floor, floor)]
        except KeyError:
            known = sorted(self._storeys)
            raise KeyError(f"nothing was seen yet of floor {floor!r}; there are maps of {known}") from None

    def storey_at(self, z_m: float) -> str:
        """The storey at an altitude [m, world], within tau_z; "" if there is none."""
        near = [(abs(s.geometry.z_m - z_m), name) for name, s in self._storeys.items()]
        distance_m, name = min(near, default=(math.inf, ""))
        return name if distance_m <= self.config.map.tau_z_m else ""

    def _storey_of(self, view: PosedView) -> _Storey:
        """The storey at the view's estimated floor altitude (tau_z); a new one if there is none.

        A robot that climbs fits no storey half-way up: what it sees there goes to the storey that it left. It opens one
        only where it stays: where it walked on one level, or looked around on it under a new floor name. A camera
        doesn't climb, nor does a robot that came from nowhere.
        """
        z_m = view.floor_z_m
        name = self.storey_at(z_m)
        if not name and self._climbs(view):
            return self._storeys[self._walks[view.source].storey]
        if not name:
            name = self._new_name(view.floor)
            if len(self._storeys) >= self.config.map.max_floors:
                most = self.config.map.max_floors
                raise ViewError(
                    "too_many_floors", f"a view at {z_m:.1f} m would make more than {most} floors (max_floors)"
                )
            self._open(name, z_m, (float(view.T_world_camera[0, 3]), float(view.T_world_camera[1, 3])))
        return self._storeys[name]

    def _climbs(self, view: PosedView) -> bool:
        """Whether a robot at an altitude of no storey is on a stair."""
        c, walk = self.config.map, self._walks.get(view.source)
        if walk is None or walk.storey not in self._storeys or abs(view.floor_z_m - walk.z_m) > c.stair_step_m:
            return False
        x, y, z = (float(v) for v in (*view.T_world_camera[:2, 3], view.floor_z_m))
        walk = walk.on(walk.storey, x, y, z)
        looked = view.floor not in self._storeys and walk.views >= c.level_views
        stays = looked or math.dist(walk.level_m[:2], (x, y)) >= c.level_m
        return not stays

    def _walk_on(self, view: PosedView, storey: str) -> None:
        if view.is_robot:
            x, y, z = (float(v) for v in (*view.T_world_camera[:2, 3], view.floor_z_m))
            walk = self._walks.get(view.source, _Walk(storey, z, (x, y, z), 0))
            self._walks[view.source] = walk.on(storey, x, y, z)

    def _new_name(self, said: str) -> str:
        name, k = said, 2
        while name in self._storeys:  # two altitudes under one name: split levels, or a lie
            name, k = f"{said}-{k}", k + 1
        return name

    def _open(self, name: str, z_m: float, centre_m: tuple[float, float]) -> None:
        c = self.config
        self._storeys[name] = _Storey(
            FloorMap(name, z_m, centre_m, c.map), ValueMap(c.value), ObjectMap(name, z_m, c.map.voxel_m, c.objects)
        )

    @classmethod
    def unseen(cls, floor: str, z_m: float, centre_m: tuple[float, float], config: FusionConfig) -> JointMap:
        """Maps that hold one storey of which nothing is known yet."""
        joint = cls(config)
        joint._open(floor, z_m, centre_m)
        return joint

    def state(self) -> dict[str, Any]:
        """All of it, as plain arrays and values, for ``of_state``; nothing in it changes when the maps do."""
        return {
            "revision": self.revision, "guard": self.guard.state(), "name_of": dict(self._name_of),
            "walks": {robot: asdict(walk) for robot, walk in self._walks.items()},
            "storeys": [
                {"geometry": _with_own_layers(s.geometry.state()), "value": s.value.state(), "objects": s.objects.state()}
                for s in self._storeys.values()
            ],
        }  # fmt: skip

    @classmethod
    def of_state(cls, state: dict[str, Any], config: FusionConfig) -> JointMap:
        """The joint maps that ``state`` was taken of."""
        joint = cls(config)
        joint.revision, joint._name_of = state["revision"], dict(state["name_of"])
        joint.guard = Guard.of_state(state["guard"], config.guard)
        for robot, walk in state["walks"].items():
            x, y, z = walk["level_m"]
            joint._walks[robot] = _Walk(walk["storey"], walk["z_m"], (x, y, z), walk["views"])
        for storey in state["storeys"]:
            geometry = FloorMap.of_state(storey["geometry"], config.map)
            joint._storeys[geometry.floor] = _Storey(
                geometry, ValueMap.of_state(storey["value"], config.value),
                ObjectMap.of_state(storey["objects"], geometry.floor, geometry.z_m, config.map.voxel_m, config.objects),
            )  # fmt: skip
        return joint


def _with_own_layers(geometry: dict[str, Any]) -> dict[str, Any]:
    """The state of a floor's geometry with copies of its layers: all else in it is a copy already, or never changes."""
    return geometry | {"layers": {name: layer.copy() for name, layer in geometry["layers"].items()}}


def canonical(views: Iterable[PosedView]) -> list[PosedView]:
    """The one order in which views of a step are integrated: by time, then source, then view."""
    return sorted(views, key=lambda v: (v.stamp_ns, v.source, v.view, v.seq))
