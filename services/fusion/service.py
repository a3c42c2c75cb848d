"""The fusion service: views in, joint maps out."""

from __future__ import annotations

import threading
import time
from typing import cast

import numpy as np
from numpy.typing import NDArray

from services.fusion.config import FusionSettings
from services.fusion.core import JointMap
from services.fusion.perceiver import Perceived, Perceiver
from services.fusion.sources import Sources
from surveilnav.contract import MAP_LAYER, MAP_REVISION, OBJECTS
from surveilnav.errors import BusError, PerceptionError
from surveilnav.messages import DEFAULT_LAYERS, CameraUse, LayerHeader, ObjectList, Revision
from surveilnav.messages.maps import LayerName
from surveilnav.runtime import Answer, Node, Publisher, Refused, Request, clock_ns
from surveilnav.sensing.packing import pack_array, unpack_embedding

_HEARTBEAT_S = 1.0
_MAX_FLOORS = 64


class FusionService:
    """Follows robots, invokes cameras, has perception look at every new view, and keeps the joint maps."""

    def __init__(self, node: Node, settings: FusionSettings) -> None:
        self._node, self._settings = node, settings
        self._joint = JointMap(settings.core())
        self._lock = threading.Lock()  # the joint map belongs to the loop and to those who answer queries
        self._sources = Sources(node, settings, self._joint.config.map.tau_z_m)
        self._perceiver = Perceiver(node, settings)
        self._robots: dict[str, tuple[str, int]] = {}  # robot -> floor and newest observation in the maps
        self._held: dict[str, set[int]] = {}  # camera -> views in the maps
        self._waiting_on: dict[str, float] = {}  # floors that robots say they are on -> altitude
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
        for frame in frames:
            header = frame.message
            if header.source.startswith("robot/") and len(self._waiting_on) < _MAX_FLOORS:
                self._waiting_on[header.floor] = header.T_world_camera.translation_m[2] - header.mounting_offset_m
            self._perceiver.submit(frame)
        # robots first; cameras' views in slices, so that a robot never waits for many
        finished = self._perceiver.robots() or self._perceiver.cameras(self._settings.camera_views_per_step)
        for perceived in sorted(finished, key=lambda p: (p.header.stamp_ns, p.key)):
            self._integrate(perceived)
        self._publish()
        return bool(frames or finished)

    def _integrate(self, perceived: Perceived) -> None:
        source, view = perceived.key
        floor = perceived.header.floor
        if perceived.view is not None:
            try:
                with self._lock:
                    floor = self._joint.integrate(perceived.view, perceived.perception).floor
            except ValueError as error:
                self._node.reject("view", f"{source} view {view}: {error}")
                return
        kind, _, name = source.partition("/")
        if kind == "robot":
            self._robots[name] = floor, perceived.header.seq
        else:
            self._held.setdefault(name, set()).add(view)

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
        with self._lock:
            floors = {name: (z_m, self._joint.floor_revision(name)) for name, z_m in self._joint.floors.items()}
        tau_z_m = self._joint.config.map.tau_z_m
        for name, z_m in list(self._waiting_on.items()):  # a robot stands there and nothing was integrated yet
            if all(abs(z_m - known_m) > tau_z_m for known_m, _ in floors.values()) and name not in floors:
                floors[name] = z_m, 0
        return [self._revision(name, z_m, number) for name, (z_m, number) in sorted(floors.items())]

    def _revision(self, floor: str, z_m: float, number: int) -> Revision:
        cameras, pending = [], 0
        for name, camera in sorted(self._sources.cameras.items()):
            if abs(camera.info.position_m[2] - camera.info.mounting_offset_m - z_m) <= self._joint.config.map.tau_z_m:
                held = len(self._held.get(name, set()) & set(camera.slots))
                cameras.append(CameraUse(name, held, len(camera.slots)))
                pending += 0 if camera.silent else len(camera.slots) - held
        return Revision(
            stamp_ns=clock_ns(), floor=floor, revision=number, floor_z_m=z_m, cameras=cameras, pending_views=pending,
            robots={robot: seq for robot, (on, seq) in sorted(self._robots.items()) if on == floor},
            perception_ok=not self._perceiver.problem, message=self._perceiver.problem,
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
            with self._lock:
                grid, array = self._joint.layer(floor, layer, text_embedding)
                revision = self._joint.floor_revision(floor)
        except KeyError as error:
            raise Refused("unknown_floor", str(error.args[0])) from error
        header = LayerHeader(
            stamp_ns=clock_ns(), floor=floor, layer=cast("LayerName", layer), revision=revision, grid=grid,
            dtype="uint8" if array.dtype == np.uint8 else "float32", shape=array.shape, target=target,
        )  # fmt: skip
        return Answer(header, pack_array(array))

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
        floor = request.ids.get("floor")
        answers = []
        with self._lock:
            floors = [floor] if floor is not None else sorted(self._joint.floors)
            for name in floors:
                try:
                    objects, revision = self._joint.objects(name), self._joint.floor_revision(name)
                except KeyError as error:
                    raise Refused("unknown_floor", str(error.args[0])) from error
                message = ObjectList(stamp_ns=clock_ns(), floor=name, revision=revision, objects=objects)
                answers.append(Answer(message, ids={"floor": name}))
        return answers

    def _revisions(self, request: Request) -> list[Answer]:
        floor = request.ids.get("floor")
        revisions = [said for said, _ in list(self._said.values()) if floor in (None, said.floor)]
        if not revisions and floor is not None:
            raise Refused("unknown_floor", f"nothing was seen yet of floor {floor!r}")
        return [Answer(said, ids={"floor": said.floor}) for said in revisions]


def _unstamped(revision: Revision) -> tuple[object, ...]:
    r = revision
    return r.revision, r.robots, r.cameras, r.pending_views, r.perception_ok, r.message
