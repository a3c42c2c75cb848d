"""What robots and cameras saw of a home, kept: the same detections for every way to make objects of them.

A recording holds, for every view, pose, depth as it travels on the bus, what perception said as a worker replies it,
and (for the study alone) which instance each detection shows. The robot's tour: places of a floor by farthest-point
sampling, visited nearest first by the shortest ways, a look around at each.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.benchmark.play.sight import Sight, Sighted
from surveilnav.geometry import Pinhole, Pose
from surveilnav.messages import InferReply, ModelIds
from surveilnav.perception.backend import Backend, Stage, ViewTask
from surveilnav.robot_body import STEP_M, TURN_RAD
from surveilnav.robot_state import RobotState
from surveilnav.sensing.packing import decode_depth, encode_depth, perception_from_wire, perception_to_wire
from surveilnav.sensing.views import DetectedObject, PosedView, ViewPerception, box_cells
from surveilnav.simulator.simulation import SimulatedBuilding
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.scene import Scene
from surveilnav.storage import read_parts, write_parts

#: Instances of these classes are the building itself: a detection on them is one of background.
STRUCTURE = frozenset({"wall", "floor", "ceiling", "door", "window", "stairs"})
LOOK_DOWN_RAD = math.radians(-30.0)
_FORMAT = b"surveilnav recording 2"
_NO_PICTURE = np.zeros((0, 0, 3), np.uint8)


@dataclass(frozen=True, slots=True)
class Tour:
    """How a robot looks at a home: about so many views, around in such turns, and every so far on its ways."""

    views: int
    turn_rad: float
    step_m: float


#: ``sparse``: much of a home in few views. ``dense``: a view after every action, as a robot that searches has them.
TOURS = {
    "sparse": Tour(200, math.radians(60.0), 0.75),
    "dense": Tour(500, TURN_RAD, STEP_M),
}


class Thing(msgspec.Struct, frozen=True):
    """An instance of the scene that is no part of the building: what an object of the map should be."""

    id: int
    label: str
    floor: str
    p_min: tuple[float, float, float]
    p_max: tuple[float, float, float]


class Facts(msgspec.Struct, frozen=True):
    """What a recording is of: everything that it depends on."""

    building: str
    seed: int
    perception: str
    robot_views: int
    scene_hash: str


class _Home(msgspec.Struct, frozen=True):
    facts: Facts
    things: list[Thing]
    n_views: int


class _Stored(msgspec.Struct, frozen=True):
    source: str
    view: int
    seq: int
    stamp_ns: int
    floor: str
    T_world_camera: Pose
    camera: Pinhole
    mounting_offset_m: float
    depth_range_m: tuple[float, float]
    depth: bytes
    reply: InferReply | None
    truth: list[tuple[int, float]]


@dataclass(frozen=True, slots=True, eq=False)
class SeenView:
    """A view without its colours, what perception said (None: not asked), and (instance id, its share of the mask's
    pixels) of each detection; id 0: background."""

    view: PosedView
    perception: ViewPerception | None
    truth: tuple[tuple[int, float], ...]


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A home as it was seen; ``views`` in the order in which they are integrated, cameras first."""

    facts: Facts
    things: dict[int, Thing]
    views: list[SeenView]


class Witness(Backend):
    """A backend that also notes, for every detection, which instance it shows. The backend itself isn't told."""

    needs_truth = True

    def __init__(self, inner: Backend, things: dict[int, Thing]) -> None:
        self._inner, self._things = inner, things
        self.name, self.why, self.embedding_dim = inner.name, inner.why, inner.embedding_dim
        self.models, self.vocabulary = inner.models, inner.vocabulary
        self.stages = (Stage("witness", self._look),)
        self.seen: dict[tuple[object, ...], tuple[tuple[int, float], ...]] = {}

    def _look(self, batch: Sequence[ViewTask]) -> None:
        for task in batch:
            task.result = self._witnessed(task)

    def _witnessed(self, task: ViewTask) -> ViewPerception:
        if task.truth is None:
            raise ValueError("a witness needs the true instances of every view")
        view, told = task.view, task.truth if self._inner.needs_truth else None
        perception = self._inner.perceive(
            view.rgb, view.depth_m, view.camera, prompts=task.prompts, truth=told, key=task.key
        )
        self.seen[task.key] = tuple(instance_of(d, task.truth.ids, self._things) for d in perception.detections)
        return perception

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """See ``Backend``."""
        return self._inner.embed_texts(texts)


def instance_of(detected: DetectedObject, ids: NDArray[np.uint16], things: dict[int, Thing]) -> tuple[int, float]:
    """(instance, share) that most pixels of a detection's mask show; (0, share) if that is the building or nothing."""
    height, width = ids.shape
    x0, y0, x1, y1 = box_cells(detected.box_px, width, height)
    inside = ids[y0:y1, x0:x1]
    shown = inside[detected.mask] if detected.mask is not None else inside.ravel()
    if shown.size == 0:
        return 0, 0.0
    counts = np.bincount(np.where(np.isin(shown, list(things)), shown, 0))
    most = int(counts.argmax())
    return most, float(counts[most]) / shown.size


def things_of(scene: Scene) -> dict[int, Thing]:
    """The instances of a scene that aren't the building itself, by id."""
    return {i.id: Thing(i.id, i.label, i.floor, i.p_min, i.p_max) for i in scene.instances if i.label not in STRUCTURE}


# --- recording ----------------------------------------------------------------------------------------------------


def record(
    building: SimulatedBuilding, backend: Backend, tour: Tour, on_view: Callable[[int, int], None] | None = None
) -> Recording:
    """Sees a home: all cameras' views, then a robot's tour. ``on_view(done, of)`` is told."""
    things = things_of(building.scene)
    witness = Witness(backend, things)
    sight = Sight(building, witness)
    states = states_of(building.navigation, tour)
    total = sum(len(info.views) for info in sight.infos) + len(states)
    seen: list[SeenView] = []

    def add(sighted: Sighted) -> None:
        view = sighted.view
        seen.append(SeenView(view, sighted.perception, witness.seen.get((view.source, view.view, view.seq), ())))
        if on_view is not None:
            on_view(len(seen), total)

    for info in sight.infos:
        for sighted in sight.camera(info.camera):
            add(sighted)
        sight.camera.cache_clear()
    for state in states:
        add(sight.robot(state))
    settings = building.settings
    facts = Facts(settings.building, settings.seed, backend.name, tour.views, building.scene.content_hash)
    return Recording(facts, things, seen)


def states_of(navigation: NavigationMap, tour: Tour) -> list[RobotState]:
    """Where a robot looks from on a tour, floors by their area; ``seq`` counts from 1."""
    areas = {name: float(area.sum()) for name, area in navigation.robot_area.items() if area.any()}
    states: list[RobotState] = []
    for floor, area in areas.items():
        share = round(tour.views * area / sum(areas.values()))
        for n_places in range(max(1, round(share * tour.turn_rad / (2 * math.pi))), 0, -1):
            stops = list(_stops(navigation, floor, n_places, tour))
            if len(stops) <= share:
                break
        z_m = navigation.floors[floor].z_m
        for (x, y), yaw, pitch in stops:
            states.append(RobotState(x, y, z_m, floor, yaw, pitch, seq=len(states) + 1))
    return states


def _stops(
    navigation: NavigationMap, floor: str, n_places: int, tour: Tour
) -> Iterator[tuple[tuple[float, float], float, float]]:
    """((x, y), yaw, pitch) of every view: along the ways level, around at the places level or, at every third, down."""
    left = _places(navigation, floor, n_places)
    here = left.pop(0)
    headings = round(2 * math.pi / tour.turn_rad)
    for number in range(n_places):
        for k in range(headings):
            yaw = 2 * math.pi * k / headings
            yield here, math.remainder(yaw, 2 * math.pi), LOOK_DOWN_RAD if number % 3 == 2 else 0.0
        if not left:
            return
        field = navigation.distance_field({floor: [here]})
        there = min(left, key=lambda p: (field.at(p, floor), p))
        left.remove(there)
        way = navigation.distance_field({floor: [there]}).path_from(here, floor)
        corners = [(w.x_m, w.y_m) for w in way if w.floor == floor]
        for a, b in itertools.pairwise(corners):
            length_m, yaw = math.dist(a, b), math.atan2(b[1] - a[1], b[0] - a[0])
            for i in range(int(length_m / tour.step_m)):
                t = (i + 1) * tour.step_m / length_m
                yield (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])), yaw, 0.0
        here = there


def _places(navigation: NavigationMap, floor: str, n: int) -> list[tuple[float, float]]:
    """Farthest-point sampling by way: the place nearest to the middle first, then always the farthest one."""
    area = navigation.robot_area[floor]
    inside = area & navigation.floors[floor].indoor
    cells = np.argwhere(inside if inside.any() else area)
    xy = navigation.floors[floor].grid.centres_of(cells)
    chosen = [int(np.argmin(np.linalg.norm(xy - xy.mean(axis=0), axis=1)))]
    while len(chosen) < min(n, len(cells)):
        away = navigation.distance_field({floor: xy[chosen]}).distance_m[floor][cells[:, 0], cells[:, 1]]
        chosen.append(int(np.where(np.isfinite(away), away, -1.0).argmax()))
    return [(float(x), float(y)) for x, y in xy[chosen]]


# --- keeping ------------------------------------------------------------------------------------------------------


def save(recording: Recording, path: Path) -> None:
    """Writes a recording to a file, whole or not at all."""
    home = _Home(recording.facts, list(recording.things.values()), len(recording.views))
    parts = [msgspec.msgpack.encode(part) for part in (home, *map(_stored, recording.views))]
    write_parts(path, _FORMAT, parts)


def load(path: Path) -> Recording | None:
    """What ``save`` wrote; None if there is no such file, or it is damaged."""
    parts = read_parts(path, _FORMAT)
    if parts is None:
        return None
    home = msgspec.msgpack.decode(parts[0], type=_Home)
    views = [_seen(msgspec.msgpack.decode(part, type=_Stored)) for part in parts[1:]]
    return Recording(home.facts, {t.id: t for t in home.things}, views)


def _stored(seen: SeenView) -> _Stored:
    view, reply = seen.view, None
    if seen.perception is not None:
        detections, image = perception_to_wire(seen.perception)
        reply = InferReply(
            stamp_ns=view.stamp_ns,
            worker="recording",
            backend=seen.perception.backend,
            source=view.source,
            view=view.view,
            seq=view.seq,
            detections=detections,
            image_embedding=image,
            models=ModelIds(embedder=seen.perception.embedding_model),
            words=list(seen.perception.words),
        )
    return _Stored(
        view.source,
        view.view,
        view.seq,
        view.stamp_ns,
        view.floor,
        Pose.from_matrix(view.T_world_camera),
        view.camera,
        view.mounting_offset_m,
        view.depth_range_m,
        encode_depth(view.depth_m, view.depth_range_m),
        reply,
        list(seen.truth),
    )


def _seen(s: _Stored) -> SeenView:
    depth_m = decode_depth(s.depth, s.camera.width_px, s.camera.height_px, s.depth_range_m)
    view = PosedView(
        s.source,
        s.view,
        s.seq,
        s.stamp_ns,
        s.floor,
        s.T_world_camera.matrix(),
        s.camera,
        s.mounting_offset_m,
        _NO_PICTURE,
        depth_m,
        s.depth_range_m,
    )
    perception = perception_from_wire(s.reply, s.camera) if s.reply is not None else None
    return SeenView(view, perception, tuple(s.truth))
