"""The joint map: the views of all robots and cameras, integrated into one set of maps per floor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Grid
from surveilnav.messages.maps import LAYERS, ObjectRecord
from surveilnav.sensing.views import PosedView, ViewPerception
from surveilnav.services.fusion.core.config import FusionConfig
from surveilnav.services.fusion.core.maps.climbing import ClimbTracker
from surveilnav.services.fusion.core.maps.floor_map import FloorMap
from surveilnav.services.fusion.core.maps.value import PendingLayer, ValueMap
from surveilnav.services.fusion.core.objects.map_object import ObjectChange
from surveilnav.services.fusion.core.objects.object_map import ObjectMap
from surveilnav.services.fusion.core.views.floor_fit import with_corrected_depth
from surveilnav.services.fusion.core.views.invocation import same_floor
from surveilnav.services.fusion.core.views.order import KnownFloor, ViewFootprint, floor_utilities_m2, visible_ranges_m
from surveilnav.services.fusion.core.views.quarantine import Quarantine
from surveilnav.services.fusion.core.views.validation import ViewError, ViewValidator, check_view

_MAX_NAMES = 256  # of floors, since a robot may send any name


@dataclass(frozen=True, slots=True)
class IntegrationResult:
    """What a view changed in the maps.

    Attributes:
        floor: the floor that it was integrated into.
        revision: revision of the joint map after the view.
        n_points: number of its points in the cloud.
        n_located: number of its detections that could be located in the world.
    """

    floor: str
    revision: int
    n_points: int
    n_located: int
    changes: tuple[ObjectChange, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class _FloorMaps:
    geometry: FloorMap
    value: ValueMap
    objects: ObjectMap


@dataclass(frozen=True, slots=True, eq=False)
class _AddedGeometry:
    """What a view added to the geometry of a floor: a number of points. Also its ranges by azimuth (360, 2) [m]."""

    maps: _FloorMaps
    n_points: int
    ranges_m: NDArray[np.float32]


class JointMap:
    """The joint maps of a building: one set of maps per floor.

    Attributes:
        revision: number of views that have changed the maps.
        validator, quarantine: refuse views that can't follow the previous one of their source, or whose place is wrong.
    """

    def __init__(self, config: FusionConfig | None = None) -> None:
        self.config = config or FusionConfig()
        self.revision = 0
        self.validator, self.quarantine = ViewValidator(self.config.validation), Quarantine(self.config.validation)
        self._floors: dict[str, _FloorMaps] = {}
        self._name_of: dict[str, str] = {}  # a source's name for a floor -> the map's name for it
        self._climbs: dict[str, ClimbTracker] = {}  # by robot

    @property
    def floors(self) -> dict[str, float]:
        """The altitude [m, world] of each floor, by id."""
        return {name: maps.geometry.z_m for name, maps in self._floors.items()}

    def accept(self, view: PosedView, perception: ViewPerception | None) -> IntegrationResult | None:
        """Validates a view that came from outside and integrates it.

        A camera's picture that the maps hold already may come again, with what perception found in it for more words or
        with the embedding of another model; then only that is added.

        Returns:
            What the view changed; None if it changed nothing, since the maps hold all of it.

        Raises:
            ViewError: the view can't be, by itself or after the previous one of its source. The maps stay as they were.
        """
        check_view(view, perception)
        validation = self.validator.validate(view)
        self.validator.record_arrival(view, validation)
        if validation.fault is not None:
            raise validation.fault
        if validation.is_new:
            here = self._floors.get(self.floor_at(view.floor_z_m))
            self.quarantine.check(view, here.geometry.cloud if here else None)
        corrected = with_corrected_depth(view, self.config.estimated_depth)
        geometry = self._add_geometry(corrected) if validation.is_new else None
        result = self.add_detections(corrected, perception, geometry)
        if result is not None:
            self.validator.record_integrated(view, perception)
            if view.is_robot:
                self.quarantine.record_robot_view(view, self._floors[result.floor].geometry.cloud, self.validator)
        return result

    def integrate(self, view: PosedView, perception: ViewPerception | None) -> IntegrationResult:
        """Integrates one view without comparing it with earlier ones.

        Views of one step are integrated in the order of ``in_order``. Cloud, occupancy and exploration don't depend on the
        order, but values and objects may.

        Args:
            perception: None: no detector looked at the view, so that it isn't negative evidence either.

        Raises:
            ViewError: the view can't be by itself. The maps stay as they were.
        """
        check_view(view, perception)
        view = with_corrected_depth(view, self.config.estimated_depth)
        result = self.add_detections(view, perception, self._add_geometry(view))
        assert result is not None  # the view added its geometry
        return result

    def _add_geometry(self, view: PosedView) -> _AddedGeometry:
        """Adds a new picture to the maps of its floor: of obstacles and exploration, and if measured to the point cloud.

        A view without depth adds nothing to them. What it shows reaches as far as the floor is free by what the maps know.
        """
        maps = self._floor_of(view)
        if view.depth_source == "none":
            self._record_name(view, maps)
            range_m = self.config.map.value_range_without_depth_m
            footprint = ViewFootprint.from_view(view.T_world_camera, view.camera, maps.geometry.z_m, range_m)
            return _AddedGeometry(maps, 0, visible_ranges_m(footprint, self.known_floor(maps.geometry.floor)))
        try:
            if view.depth_source == "sensor":
                n_points, ranges_m = maps.geometry.integrate(view)
            else:
                n_points, ranges_m = maps.geometry.integrate_estimated(view, view.depth_uncertainty.sigma)
        except ValueError as error:
            self._forget_if_new(maps)
            raise ViewError("out_of_map", str(error)) from error
        self._record_name(view, maps)
        self._record_altitude(view, maps.geometry.floor)
        return _AddedGeometry(maps, n_points, ranges_m)

    def add_detections(
        self, view: PosedView, perception: ViewPerception | None, geometry: _AddedGeometry | None = None
    ) -> IntegrationResult | None:
        """Adds what perception found in a view to the value map and the objects of its floor, and counts the revision.

        Args:
            perception: None: no detector looked.
            geometry: what the view added to the geometry of its floor. None: the maps hold this picture of a camera
                already, and perception looked for more words in it, or with another embedding model.

        Returns:
            What changed; None if nothing is new.
        """
        if geometry is None and (perception is None or view.is_robot):
            return None
        maps = geometry.maps if geometry else self._floor_of(view)
        detections = () if perception is None else perception.detections
        embedded = False
        # value map (eq. 2)
        if perception is not None and perception.image_embedding.size:
            ranges_m = geometry.ranges_m if geometry else None
            embedded = maps.value.add(view, perception.image_embedding, perception.embedding_model, ranges_m)
        if geometry is None and perception is not None:
            words = self.validator.new_words(view, perception)
            if not (words or embedded):
                return None
            detections = tuple(d for d in detections if d.label in words)
        self.revision += 1
        maps.geometry.revision = self.revision
        # object map (eq. 3)
        n_located = 0
        if perception is not None:
            n_located = maps.objects.add_detections(view, detections, perception.embedding_model)
        changes = tuple(maps.objects.pop_changes(self.revision))
        n_points = geometry.n_points if geometry else 0
        return IntegrationResult(maps.geometry.floor, self.revision, n_points, n_located, changes)

    def _forget_if_new(self, maps: _FloorMaps) -> None:
        """Removes a floor that was opened for a view which was then refused."""
        if maps.geometry.revision == 0:
            self._floors.pop(maps.geometry.floor, None)

    def _record_name(self, view: PosedView, maps: _FloorMaps) -> None:
        """Records what the source of an integrated view calls its floor, unless it is on a stair, where names mean nothing."""
        name = maps.geometry.floor
        if maps.geometry.revision == 0:
            self._name_of[name] = name  # even if another floor was called so before
        if self.floor_at(view.floor_z_m) == name and len(self._name_of) < _MAX_NAMES:
            self._name_of.setdefault(view.floor, name)

    def layer(
        self, floor: str, name: str, text_embedding: NDArray[np.floating] | None = None, embedding_model: str = ""
    ) -> tuple[Grid, NDArray[np.generic]]:
        """A layer of a floor, and its frame.

        Layers (rows, cols) are ``occupancy``, ``explored`` and ``frontier`` (uint8), and ``value`` (float32, for the embedding of
        a text). ``cloud`` is (N, 6) float32, positions [m, world] and colours. ``provenance`` is (N, 3) int64, line by line with
        the cloud: number in ``source_sets``, first and last seen [ns].

        Raises:
            KeyError: no such floor or layer. ValueError: value without a text embedding.
        """
        maps = self._named(floor)
        geometry = maps.geometry
        if name == "occupancy":
            return geometry.grid, geometry.occupancy()
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
        return self._name_of.get(floor, floor) in self._floors

    def pending_value(
        self, floor: str, text_embedding: NDArray[np.floating], embedding_model: str = ""
    ) -> PendingLayer | None:
        """The value layer of a new target, to be built while the maps change; None if there is one. KeyError: no such floor."""
        maps = self._named(floor)
        return maps.value.pending(text_embedding, maps.geometry.grid.resolution_m, embedding_model)

    def adopt_value(self, floor: str, built: PendingLayer) -> None:
        """Keeps a value layer that was built. KeyError: no such floor."""
        self._named(floor).value.adopt(built)

    def objects(self, floor: str, since: int = -1) -> list[ObjectRecord]:
        """The objects of a floor by id, or those that changed after revision ``since``. KeyError: no such floor."""
        return self._named(floor).objects.records(since)

    def object_ids(self, floor: str) -> list[int]:
        """The ids of all objects of a floor. KeyError: no such floor."""
        return self._named(floor).objects.ids()

    def relevances(self, floor: str, text: NDArray[np.float32], embedding_model: str) -> dict[int, float | None]:
        """Cosine of the embeddings of a floor's objects and a text (D,), by object id. KeyError: no such floor."""
        return self._named(floor).objects.relevances(text, embedding_model)

    def views_left_out(self, floor: str, embedding_model: str) -> int:
        """The number of a floor's views that another model has embedded. KeyError: no such floor."""
        return self._named(floor).value.views_left_out(embedding_model)

    def source_sets(self, floor: str) -> list[list[str]]:
        """The source sets by number, for the layer ``provenance`` of a floor. KeyError: no such floor."""
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

    def view_utilities(
        self, views: Sequence[ViewFootprint], robots_m: Sequence[tuple[float, float, float]]
    ) -> NDArray[np.float64]:
        """The utilities (K,) of camera views: how much they may still show near robots, given the maps now (``views.order``).

        Views of a floor without a robot have utility 0.

        Args:
            robots_m: (x, y, altitude of the floor) [m, world] of all robots.
        """
        utilities_m2 = np.zeros(len(views))
        for floor_z_m in sorted({view.floor_z_m for view in views}):
            here = [(x, y) for x, y, z_m in robots_m if same_floor(z_m, floor_z_m, self.config.map.tau_z_m)]
            if here:
                rows = [k for k, view in enumerate(views) if view.floor_z_m == floor_z_m]
                known = self.known_floor(self.floor_at(floor_z_m))
                on_floor = [views[k] for k in rows]
                utilities_m2[rows] = floor_utilities_m2(on_floor, known, np.array(here), self.config.views)
        return utilities_m2

    def known_floor(self, floor: str) -> KnownFloor | None:
        """The layers of a floor; None for "" (``floor_at``)."""
        if not floor:
            return None
        geometry = self._floors[floor].geometry
        return KnownFloor(geometry.grid, geometry.occupied(), geometry.explored(), geometry.frontier())

    def floor_at(self, z_m: float) -> str:
        """The nearest floor within tau_z (eq. 1) of an altitude [m, world]; "" if there is none."""
        near = [(abs(maps.geometry.z_m - z_m), name) for name, maps in self._floors.items()]
        _, name = min(near, default=(math.inf, ""))
        return name if name and same_floor(self._floors[name].geometry.z_m, z_m, self.config.map.tau_z_m) else ""

    def _floor_of(self, view: PosedView) -> _FloorMaps:
        """The maps of the floor that a view belongs to; opens a new floor if there is none within tau_z of its altitude.

        A robot on a stair is at no floor's altitude. What it sees there goes to the floor that it left. It opens a new
        floor only where it stays: where it has moved along one level, or has looked around there under a new floor name. Cameras
        don't climb, and neither does a robot whose first view this is.
        """
        z_m = view.floor_z_m
        name = self.floor_at(z_m)
        if not name and self._is_on_stair(view):
            return self._floors[self._climbs[view.source].floor]
        if not name:
            name = self._new_name(view.floor)
            if len(self._floors) >= self.config.map.max_floors:
                limit = self.config.map.max_floors
                raise ViewError(
                    "too_many_floors", f"a view at {z_m:.1f} m would make more than {limit} floors (max_floors)"
                )
            self._open(name, z_m, (float(view.T_world_camera[0, 3]), float(view.T_world_camera[1, 3])))
        return self._floors[name]

    def _is_on_stair(self, view: PosedView) -> bool:
        """Whether a robot whose altitude is that of no floor is on a stair."""
        climb = self._climbs.get(view.source)
        if climb is None or climb.floor not in self._floors:
            return False
        return climb.is_on_stair(view, self.config.map, new_name=view.floor not in self._floors)

    def _record_altitude(self, view: PosedView, floor: str) -> None:
        """Follows the altitude of a robot, to distinguish a stair from a floor."""
        if view.is_robot:
            climb = self._climbs.get(view.source)
            self._climbs[view.source] = climb.after(view, floor) if climb else ClimbTracker.from_first_view(view, floor)

    def _new_name(self, source_name: str) -> str:
        name, k = source_name, 2
        while name in self._floors:  # two altitudes under one name: split levels, or an error
            name, k = f"{source_name}-{k}", k + 1
        return name

    def _open(self, name: str, z_m: float, centre_m: tuple[float, float]) -> None:
        c = self.config
        self._floors[name] = _FloorMaps(
            FloorMap(name, z_m, centre_m, c.map), ValueMap(c.value), ObjectMap(name, z_m, c.map.voxel_m, c.objects)
        )

    @classmethod
    def unseen(cls, floor: str, z_m: float, centre_m: tuple[float, float], config: FusionConfig) -> JointMap:
        """Joint maps of one floor of which nothing is known yet."""
        joint = cls(config)
        joint._open(floor, z_m, centre_m)
        return joint

    def state(self) -> dict[str, Any]:
        """Everything as plain arrays and values, for ``from_state``; nothing in it changes when the maps do."""
        return {
            "revision": self.revision,
            "validator": self.validator.state(),
            "quarantine": self.quarantine.state(),
            "name_of": dict(self._name_of),
            "climbs": {robot: climb.state() for robot, climb in self._climbs.items()},
            "floors": [
                {"geometry": maps.geometry.state(), "value": maps.value.state(), "objects": maps.objects.state()}
                for maps in self._floors.values()
            ],
        }

    @classmethod
    def from_state(cls, state: dict[str, Any], config: FusionConfig) -> JointMap:
        joint = cls(config)
        joint.revision, joint._name_of = state["revision"], dict(state["name_of"])
        joint.validator = ViewValidator.from_state(state["validator"], config.validation)
        if "quarantine" in state:  # an earlier program's snapshot has none
            joint.quarantine = Quarantine.from_state(state["quarantine"], config.validation)
        joint._climbs = {robot: ClimbTracker.from_state(climb) for robot, climb in state["climbs"].items()}
        for maps in state["floors"]:
            geometry = FloorMap.from_state(maps["geometry"], config.map)
            joint._floors[geometry.floor] = _FloorMaps(
                geometry,
                ValueMap.from_state(maps["value"], config.value),
                ObjectMap.from_state(maps["objects"], geometry.floor, geometry.z_m, config.map.voxel_m, config.objects),
            )
        return joint
