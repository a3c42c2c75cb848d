"""The fusion service: views in, joint maps out."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal, cast

import msgspec
import numpy as np
from numpy.typing import NDArray

from services.fusion.config import FusionSettings
from services.fusion.core import JointMap
from services.fusion.keeper import Keeper
from services.fusion.perceiver import Perceived, Perceiver
from services.fusion.sources import Sources
from services.fusion.store import StoreError
from surveilnav.bus import Answer, Node, Publisher, Refused, Request, clock_ns
from surveilnav.contract import MAP_LAYER, MAP_REVISION, OBJECTS
from surveilnav.errors import BusError, PerceptionError
from surveilnav.messages import DEFAULT_LAYERS, CameraUse, LayerHeader, ObjectList, ObjectRecord, Revision
from surveilnav.messages.maps import LayerName
from surveilnav.sensing.packing import pack_array, unpack_embedding

_HEARTBEAT_S = 1.0
_MAX_FLOORS = 64
_MAX_TROUBLES = 3  # named in a revision's message
DType = Literal["uint8", "float32", "int64"]


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a robot says it is [m, world]; z of the floor below it."""

    x_m: float
    y_m: float
    z_m: float


class FusionService:
    """Follows robots, invokes cameras, has perception look at every new view, and keeps the joint maps."""

    def __init__(self, node: Node, settings: FusionSettings) -> None:
        self._node, self._settings = node, settings
        self._config = settings.core()
        self._keeper = Keeper(node, settings)
        self._sources = Sources(node, settings, self._config.map, self._keeper.robots)
        self._perceiver = Perceiver(node, settings, self._keeper.digests)
        self._waiting_on: dict[str, _Place] = {}  # where robots say they are, by floor
        self._publishers: dict[str, Publisher] = {}
        self._said: dict[str, tuple[Revision, float]] = {}
        # a value layer may wait for perception: the others must not wait with it
        node.serve(MAP_LAYER, self._layer, workers=3)
        node.serve(OBJECTS, self._objects)
        node.serve(MAP_REVISION, self._revisions)

    def step(self) -> bool:
        """One turn of the loop; True if there was something to do."""
        # active camera invocation (eq. 1), and the newest frame of everybody
        frames, dropped = self._sources.poll()
        for source in dropped:
            self._perceiver.withdraw(source)
        finished = []
        for frame in frames:
            header = frame.message
            if fault := self._sources.wrong_intrinsics(header):
                finished.append(Perceived((header.source, header.view), header, fault=fault))
                continue
            room = header.floor in self._waiting_on or len(self._waiting_on) < _MAX_FLOORS
            if header.source.startswith("robot/") and room:
                x_m, y_m, z_m = header.T_world_camera.translation_m
                self._waiting_on[header.floor] = _Place(x_m, y_m, z_m - header.mounting_offset_m)
            self._perceiver.submit(frame)
        # robots first; cameras' views in slices, so that a robot never waits for many
        if not self._keeper.held_up:  # else they wait where there is room for few
            finished += self._perceiver.robots() or self._perceiver.cameras(self._settings.camera_views_per_step)
        # joint maps: logged, then taken, then told of
        self._keeper.take(finished)
        self._publish()
        return bool(frames or finished)

    def close(self) -> None:
        """Ends what is being written."""
        self._keeper.close()

    # --- what the maps hold ---------------------------------------------------------------------------------------

    def _publish(self) -> None:
        """Puts the revision of each floor when it changed, and now and then for those who came late."""
        now_s = time.monotonic()
        for revision in self._all_revisions():
            said, at_s = self._said.get(revision.floor, (None, -_HEARTBEAT_S))
            same = said is not None and _unstamped(said) == _unstamped(revision)
            if same and now_s - at_s < _HEARTBEAT_S:
                continue
            self._said[revision.floor] = revision, now_s
            if revision.floor not in self._publishers:
                self._publishers[revision.floor] = self._node.publisher(MAP_REVISION, floor=revision.floor)
            self._publishers[revision.floor].put(revision)

    def _all_revisions(self) -> list[Revision]:
        joint = self._keeper.joint
        with self._keeper.lock:
            floors = {name: (z_m, joint.floor_revision(name)) for name, z_m in joint.floors.items()}
        for name, place in list(self._waiting_on.items()):  # a robot stands there and nothing was integrated yet
            tau_z_m = self._config.map.tau_z_m
            if all(abs(place.z_m - known_m) > tau_z_m for known_m, _ in floors.values()) and name not in floors:
                floors[name] = place.z_m, 0
        return [self._revision(name, z_m, number) for name, (z_m, number) in sorted(floors.items())]

    def _revision(self, floor: str, z_m: float, number: int) -> Revision:
        keeper, cameras, pending = self._keeper, [], 0
        for name, camera in sorted(self._sources.cameras.items()):
            if abs(camera.info.position_m[2] - camera.info.mounting_offset_m - z_m) <= self._config.map.tau_z_m:
                held = len(keeper.views.get(name, set()) & set(camera.slots))
                cameras.append(CameraUse(name, held, len(camera.slots)))
                pending += 0 if camera.silent else len(camera.slots) - held
        robots = {robot: held.seq for robot, held in sorted(keeper.robots.items()) if held.floor == floor}
        here = {*(f"robot/{robot}" for robot in robots), *(f"camera/{camera.camera}" for camera in cameras)}
        troubles = [why for (source, _), why in sorted(keeper.troubles.items()) if source in here]
        return Revision(
            stamp_ns=clock_ns(), floor=floor, revision=number, floor_z_m=z_m, robots=robots, cameras=cameras,
            pending_views=pending, perception_ok=not self._perceiver.problem,
            message="; ".join(filter(None, [self._perceiver.problem, keeper.problem, *troubles[:_MAX_TROUBLES]])),
        )  # fmt: skip

    # --- queries --------------------------------------------------------------------------------------------------

    def _layer(self, request: Request) -> Answer:
        floor, layer, target = request.ids.get("floor"), request.ids.get("layer"), request.parameters.get("target", "")
        if floor is None or layer not in DEFAULT_LAYERS:
            raise Refused("unknown_layer", f"ask for map/FLOOR/LAYER, with a layer of {', '.join(DEFAULT_LAYERS)}")
        text_embedding = None
        if layer == "value":
            text_embedding = self._text_embedding(target)
        try:
            if text_embedding is not None:
                self._build_value(floor, text_embedding)
            with self._keeper.lock:
                joint = self._joint_with(floor)
                grid, array = joint.layer(floor, layer, text_embedding)
                revision = joint.floor_revision(floor)
                source_sets = joint.source_sets(floor) if layer == "provenance" else []
        except KeyError as error:
            raise Refused("unknown_floor", str(error.args[0])) from error
        header = LayerHeader(
            stamp_ns=clock_ns(), floor=floor, layer=cast("LayerName", layer), revision=revision, grid=grid,
            dtype=cast("DType", str(array.dtype)), shape=array.shape, target=target, source_sets=source_sets,
        )  # fmt: skip
        return Answer(header, pack_array(array))

    def _build_value(self, floor: str, text_embedding: NDArray[np.float32]) -> None:
        """A new target's layer takes every view kept: it is built while the maps go on."""
        with self._keeper.lock:
            pending = self._joint_with(floor).pending_value(floor, text_embedding)
        if pending is not None:
            pending.build()
            with self._keeper.lock:
                self._joint_with(floor).adopt_value(floor, pending)

    def _joint_with(self, floor: str) -> JointMap:
        """The joint maps, or ones that know nothing of a floor where a robot stands whose views were all refused."""
        joint, place = self._keeper.joint, self._waiting_on.get(floor)
        held = any(robot.floor == floor for robot in list(self._keeper.robots.values()))
        if joint.knows(floor) or place is None or not held:
            return joint
        return JointMap.unseen(floor, place.z_m, (place.x_m, place.y_m), self._config)

    def _text_embedding(self, target: str) -> NDArray[np.float32]:
        if not 1 <= len(target) <= 200:
            raise Refused("bad_target", "the value layer belongs to a target: add the parameter target=NAME")
        try:
            return unpack_embedding(self._perceiver.text_embedding(f"seems like there is a {target}"))
        except Refused:
            raise
        except (BusError, PerceptionError) as error:
            raise Refused("perception_down", f"no value map of {target!r} without perception: {error}") from error

    def _objects(self, request: Request) -> list[Answer]:
        """All objects of one floor or of all; ``object=ID``: only that one; both it and ``history=all``: all events."""
        floor, wanted = request.ids.get("floor"), request.parameters.get("object", "")
        if wanted and not (wanted.isascii() and wanted.isdigit() and floor is not None):
            raise Refused("unknown_object", "ask objects/FLOOR?object=ID, ID a number")
        with self._keeper.lock:
            floors = [floor] if floor is not None else sorted(self._keeper.joint.floors)
            found = []
            for name in floors:
                try:
                    joint = self._joint_with(name)
                    found.append((name, joint.objects(name), joint.floor_revision(name)))
                except KeyError as error:
                    raise Refused("unknown_floor", str(error.args[0])) from error
        answers = []
        for name, objects, revision in found:
            if wanted:
                objects = [o for o in objects if o.id == int(wanted)]
                if not objects:
                    raise Refused("unknown_object", f"floor {name!r} has no object {wanted} (any more)")
            if wanted or request.parameters.get("history") == "all":
                objects = [self._with_history(o) for o in objects]
            message = ObjectList(stamp_ns=clock_ns(), floor=name, revision=revision, objects=objects)
            answers.append(Answer(message, ids={"floor": name}))
        return answers

    def _with_history(self, record: ObjectRecord) -> ObjectRecord:
        try:
            history = self._keeper.history(record.floor, record.id)
        except StoreError as error:
            raise Refused("store_down", f"the whole history can't be read: {error}") from error
        # after trouble with the file, or once its oldest events went, the record may know more
        if not history or (record.history and record.history[0] not in history):
            return record
        return msgspec.structs.replace(record, history=history)

    def _revisions(self, request: Request) -> list[Answer]:
        floor = request.ids.get("floor")
        revisions = [said for said, _ in list(self._said.values()) if floor in (None, said.floor)]
        if not revisions and floor is not None:
            raise Refused("unknown_floor", f"nothing was seen yet of floor {floor!r}")
        return [Answer(said, ids={"floor": said.floor}) for said in revisions]


def _unstamped(revision: Revision) -> tuple[object, ...]:
    r = revision
    return r.revision, r.robots, r.cameras, r.pending_views, r.perception_ok, r.message
