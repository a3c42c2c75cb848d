"""The joint map: every view of robots and cameras, on one map per floor."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Grid
from surveilnav.messages.maps import LAYERS, ObjectRecord
from surveilnav.sensing.views import PosedView, ViewPerception
from surveilnav.services.fusion.core.config import FusionConfig
from surveilnav.services.fusion.core.floor_map import FloorMap
from surveilnav.services.fusion.core.guard import Guard, ViewError, check
from surveilnav.services.fusion.core.invocation import same_floor
from surveilnav.services.fusion.core.map_object import ObjectChange
from surveilnav.services.fusion.core.objects import ObjectMap
from surveilnav.services.fusion.core.value import PendingLayer, ValueMap
from surveilnav.services.fusion.core.walk import Walk

_MAX_NAMES = 256  # of floors: a robot may say what it likes


@dataclass(frozen=True, slots=True)
class Integrated:
    """What a view brought: the floor it went to, its points, its detections that had a place, and changes of objects."""

    floor: str
    revision: int
    n_points: int
    n_located: int
    changes: tuple[ObjectChange, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class _FloorMaps:
    """The maps of one floor."""

    geometry: FloorMap
    value: ValueMap
    objects: ObjectMap


class JointMap:
    """The joint maps of a building. ``revision`` counts the views that they hold."""

    def __init__(self, config: FusionConfig | None = None) -> None:
        self.config = config or FusionConfig()
        self.revision = 0
        self.guard = Guard(self.config.guard)
        self._floors: dict[str, _FloorMaps] = {}
        self._name_of: dict[str, str] = {}  # what sources call a floor -> what the map calls it
        self._walks: dict[str, Walk] = {}  # by robot

    @property
    def floors(self) -> dict[str, float]:
        """Altitude [m] of each floor that was seen, by id."""
        return {name: maps.geometry.z_m for name, maps in self._floors.items()}

    def accept(self, view: PosedView, perception: ViewPerception | None) -> Integrated | None:
        """Adds a view that came from outside; None if the maps hold it already.

        Raises:
            ViewError: the view can't be, by itself or after the last one of its source. The maps stay as they were.
        """
        check(view, perception)
        if not self.guard.admit(view, perception):
            return self._look_again(view, perception)
        done = self._integrate(view, perception)
        self.guard.note(view, perception)
        return done

    def _look_again(self, view: PosedView, perception: ViewPerception | None) -> Integrated | None:
        """Adds what was found in a camera's view that the maps hold: by words that it wasn't looked at for before, or the
        embedding of another model."""
        words = self.guard.new_words(view, perception)
        if perception is None or view.is_robot:
            return None
        maps = self._floor_of(view)
        embedded = maps.value.embed_again(view, perception.image_embedding, perception.embedding_model)
        if not (words or embedded):
            return None
        self.revision += 1
        maps.geometry.revision = self.revision
        found = tuple(d for d in perception.detections if d.label in words)
        n_located = maps.objects.look_again(view, found, perception.embedding_model)
        self.guard.note(view, perception)
        return Integrated(maps.geometry.floor, self.revision, 0, n_located, tuple(maps.objects.take_changes()))

    def integrate(self, view: PosedView, perception: ViewPerception | None) -> Integrated:
        """Adds one view, whatever came before it. ``perception`` None: no detector looked (no negative evidence).

        Views of one step go in the order of ``in_order``: occupancy, exploration and cloud don't depend on it, value
        and objects may.

        Raises:
            ViewError: a view that can't be: its pictures, mask or position are wrong. The maps stay as they were.
        """
        check(view, perception)
        return self._integrate(view, perception)

    def _integrate(self, view: PosedView, perception: ViewPerception | None) -> Integrated:
        maps = self._floor_of(view)
        # point cloud, obstacle and exploration maps
        try:
            n_points, reach_m = maps.geometry.integrate(view)
        except ValueError as error:
            self._forget_if_new(maps)
            raise ViewError("out_of_map", str(error)) from error
        self._remember_name(view, maps)
        self.revision += 1
        maps.geometry.revision = self.revision
        self._walk_on(view, maps.geometry.floor)
        n_located = 0
        if perception is not None:
            # value map (eq. 2)
            if perception.image_embedding.size:
                maps.value.add(view, reach_m, perception.image_embedding, perception.embedding_model)
            # object map (eq. 3)
            n_located = maps.objects.integrate(view, perception.detections, perception.embedding_model)
        changes = tuple(maps.objects.take_changes())
        return Integrated(maps.geometry.floor, self.revision, n_points, n_located, changes)

    def _forget_if_new(self, maps: _FloorMaps) -> None:
        """Takes back a floor that only a refused view made."""
        if maps.geometry.revision == 0:
            self._floors.pop(maps.geometry.floor, None)

    def _remember_name(self, view: PosedView, maps: _FloorMaps) -> None:
        """What the source of a view that was taken calls its floor; on a stair its name means nothing yet."""
        name = maps.geometry.floor
        if maps.geometry.revision == 0:
            self._name_of[name] = name  # whatever was called so before
        if self.floor_at(view.floor_z_m) == name and len(self._name_of) < _MAX_NAMES:
            self._name_of.setdefault(view.floor, name)

    def layer(
        self, floor: str, name: str, text_embedding: NDArray[np.floating] | None = None, embedding_model: str = ""
    ) -> tuple[Grid, NDArray[np.generic]]:
        """A layer of a floor and its frame: occupancy, explored, frontier uint8; value float32; cloud (N, 6) float32;
        provenance (N, 3) int64, line by line with the cloud: number in ``source_sets``, first and last seen [ns].

        Raises:
            KeyError: no such floor or layer. ValueError: value without a text embedding.
        """
        maps = self._named(floor)
        geometry = maps.geometry
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
            raise KeyError(f"no layer {name!r}; there are {', '.join(LAYERS)}")
        if text_embedding is None:
            raise ValueError("the value layer belongs to a target: its text embedding is needed")
        return geometry.grid, maps.value.layer(geometry.grid, text_embedding, embedding_model)

    def knows(self, floor: str) -> bool:
        """Whether there is a map of a floor."""
        return self._name_of.get(floor, floor) in self._floors

    def pending_value(
        self, floor: str, text_embedding: NDArray[np.floating], embedding_model: str = ""
    ) -> PendingLayer | None:
        """A new target's value layer, to be built while the maps go on; None if it is kept. KeyError: no such floor."""
        maps = self._named(floor)
        return maps.value.pending(text_embedding, maps.geometry.grid.resolution_m, embedding_model)

    def adopt_value(self, floor: str, built: PendingLayer) -> None:
        """Keeps a pending layer that was built. KeyError: no such floor."""
        self._named(floor).value.adopt(built)

    def objects(self, floor: str) -> list[ObjectRecord]:
        """The objects of a floor. KeyError: no such floor."""
        return self._named(floor).objects.records()

    def relevances(self, floor: str, text: NDArray[np.float32], embedding_model: str) -> dict[int, float | None]:
        """By object id, how much the objects of a floor sound like a text. KeyError: no such floor."""
        return self._named(floor).objects.relevances(text, embedding_model)

    def views_left_out(self, floor: str, embedding_model: str) -> int:
        """How many views of a floor another model looked at. KeyError: no such floor."""
        return self._named(floor).value.left_out(embedding_model)

    def source_sets(self, floor: str) -> list[list[str]]:
        """The sets of sources that the layer ``provenance`` of a floor counts by. KeyError: no such floor."""
        return self._named(floor).geometry.cloud.source_sets()

    def floor_revision(self, floor: str) -> int:
        """The revision at which a floor last changed. KeyError: no such floor."""
        return self._named(floor).geometry.revision

    def _named(self, floor: str) -> _FloorMaps:
        try:
            return self._floors[self._name_of.get(floor, floor)]
        except KeyError:
            known = sorted(self._floors)
            raise KeyError(f"nothing was seen yet of floor {floor!r}; there are maps of {known}") from None

    def floor_at(self, z_m: float) -> str:
        """The nearest floor within tau_z (eq. 1) of an altitude [m, world]; "" if there is none."""
        near = [(abs(maps.geometry.z_m - z_m), name) for name, maps in self._floors.items()]
        _, name = min(near, default=(math.inf, ""))
        return name if name and same_floor(self._floors[name].geometry.z_m, z_m, self.config.map.tau_z_m) else ""

    def _floor_of(self, view: PosedView) -> _FloorMaps:
        """The floor at the view's estimated floor altitude (tau_z); a new one if there is none.

        A robot that climbs fits no floor half-way up: what it sees there goes to the floor that it left. It opens one
        only where it stays: where it walked on one level, or looked around on it under a new floor name. A camera
        doesn't climb, nor does a robot that came from nowhere.
        """
        z_m = view.floor_z_m
        name = self.floor_at(z_m)
        if not name and self._climbs(view):
            return self._floors[self._walks[view.source].floor]
        if not name:
            name = self._new_name(view.floor)
            if len(self._floors) >= self.config.map.max_floors:
                most = self.config.map.max_floors
                raise ViewError(
                    "too_many_floors", f"a view at {z_m:.1f} m would make more than {most} floors (max_floors)"
                )
            self._open(name, z_m, (float(view.T_world_camera[0, 3]), float(view.T_world_camera[1, 3])))
        return self._floors[name]

    def _climbs(self, view: PosedView) -> bool:
        """Whether a robot at an altitude of no floor is on a stair."""
        walk = self._walks.get(view.source)
        if walk is None or walk.floor not in self._floors:
            return False
        return walk.climbs(view, self.config.map, new_name=view.floor not in self._floors)

    def _walk_on(self, view: PosedView, floor: str) -> None:
        if view.is_robot:
            walk = self._walks.get(view.source)
            self._walks[view.source] = walk.on(view, floor) if walk else Walk.begun(view, floor)

    def _new_name(self, said: str) -> str:
        name, k = said, 2
        while name in self._floors:  # two altitudes under one name: split levels, or a lie
            name, k = f"{said}-{k}", k + 1
        return name

    def _open(self, name: str, z_m: float, centre_m: tuple[float, float]) -> None:
        c = self.config
        self._floors[name] = _FloorMaps(
            FloorMap(name, z_m, centre_m, c.map), ValueMap(c.value), ObjectMap(name, z_m, c.map.voxel_m, c.objects)
        )

    @classmethod
    def unseen(cls, floor: str, z_m: float, centre_m: tuple[float, float], config: FusionConfig) -> JointMap:
        """Maps that hold one floor of which nothing is known yet."""
        joint = cls(config)
        joint._open(floor, z_m, centre_m)
        return joint

    def state(self) -> dict[str, Any]:
        """All of it, as plain arrays and values, for ``of_state``; nothing in it changes when the maps do.

        Keys are those that snapshots have had from the start: "storeys" are floors.
        """
        return {
            "revision": self.revision,
            "guard": self.guard.state(),
            "name_of": dict(self._name_of),
            "walks": {robot: walk.state() for robot, walk in self._walks.items()},
            "storeys": [
                {
                    "geometry": _with_own_layers(s.geometry.state()),
                    "value": s.value.state(),
                    "objects": s.objects.state(),
                }
                for s in self._floors.values()
            ],
        }

    @classmethod
    def of_state(cls, state: dict[str, Any], config: FusionConfig) -> JointMap:
        """The joint maps that ``state`` was taken of."""
        joint = cls(config)
        joint.revision, joint._name_of = state["revision"], dict(state["name_of"])
        joint.guard = Guard.of_state(state["guard"], config.guard)
        joint._walks = {robot: Walk.of_state(walk) for robot, walk in state["walks"].items()}
        for maps in state["storeys"]:
            geometry = FloorMap.of_state(maps["geometry"], config.map)
            joint._floors[geometry.floor] = _FloorMaps(
                geometry,
                ValueMap.of_state(maps["value"], config.value),
                ObjectMap.of_state(maps["objects"], geometry.floor, geometry.z_m, config.map.voxel_m, config.objects),
            )
        return joint


def _with_own_layers(geometry: dict[str, Any]) -> dict[str, Any]:
    """The state of a floor's geometry with copies of its layers: all else in it is a copy already, or never changes."""
    return geometry | {"layers": {name: layer.copy() for name, layer in geometry["layers"].items()}}


def in_order(views: Iterable[PosedView]) -> list[PosedView]:
    """The one order in which views of a step are integrated: by time, then source, then view."""
    return sorted(views, key=lambda v: (v.stamp_ns, v.source, v.view, v.seq))
