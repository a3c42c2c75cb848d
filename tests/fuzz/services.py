"""Targets of the other services: what planner, perception, gateway, robot, camera and recorder receive."""

from __future__ import annotations

import dataclasses
import json
import tempfile
from pathlib import Path
from random import Random
from typing import Any
from unittest.mock import patch

import msgspec
import numpy as np

from surveilnav import contract
from surveilnav.bus import Received, Refused, clock_ns
from surveilnav.contract import STREAMS, Stream
from surveilnav.errors import MissionError
from surveilnav.geometry import Grid, Pose, base_pose
from surveilnav.messages import (
    FloorMapsHeader,
    InferRequest,
    LayerHeader,
    LayerPart,
    RobotStatus,
    Stair,
    StreamStatus,
    Truth,
)
from surveilnav.rest import SightingsRequest
from surveilnav.robot_state import RobotState
from surveilnav.sensing.layers import GRID_LAYERS, unpack_cloud, unpack_layer
from surveilnav.sensing.packing import pack_array
from surveilnav.sensing.truth import truth_from_wire
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.service import CameraService
from surveilnav.services.camera_node.sources.source import Picture, Place
from surveilnav.services.gateway.config import GatewaySettings
from surveilnav.services.gateway.core import layers as gateway_layers
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.resources import object_from_record
from surveilnav.services.gateway.core.selection import ObjectFilter
from surveilnav.services.gateway.service import Gateway
from surveilnav.services.perception.core.checks import check_texts, check_view
from surveilnav.services.perception.core.refusal import Refusal
from surveilnav.services.perception.pending_request import PendingRequest
from surveilnav.services.planner import service as planner_service
from surveilnav.services.planner.config import PlannerSettings
from surveilnav.services.planner.core import MissionState, PlannerConfig, RobotView, step
from surveilnav.services.planner.core.warm_up import _CHAIR, warm_up
from surveilnav.services.planner.floor_maps import FloorMapsClient
from surveilnav.services.planner.mission_bus import _fault_of, _is_stair
from surveilnav.services.planner.service import PlannerService
from surveilnav.services.planner.summaries import Summaries
from surveilnav.services.recorder.core.bus_message import BusMessage
from surveilnav.services.recorder.core.foxglove import FoxgloveConverter
from surveilnav.services.recorder.core.mcap_message import decode_bus_message
from surveilnav.services.robot_node.bodies.body import ActionBody
from surveilnav.services.robot_node.config import RobotSettings
from surveilnav.services.robot_node.service import RobotService
from tests.fuzz.maps import LENS, RANGE_M, picture, view_message
from tests.fuzz.node import FedNode, decoded, received_of
from tests.fuzz.target import Target
from tests.fuzz.values import Values

GRID = Grid(-1.0, -1.0, 0.25, 24, 24)


def ids_of(stream: Stream, values: Values) -> dict[str, str]:
    """Ids for a key of a stream, such as the fuzzer's services know."""
    known = {"floor": "0", "camera": "c1", "robot": "r1", "worker": "w1", "mission": "m1", "fusion": "f1", "view": "0"}
    return {
        name: known.get(name, "x1") if values.random.random() < 0.9 else values.random.choice(("1", "m2", "c2", "y"))
        for name in stream.fields
        if name != "building"
    }


class PerceptionRequests(Target):
    """Requests to a perception worker: checked, and decoded."""

    name, share = "perception: requests", 15
    documented = (Refusal, Refused)

    def input(self, values: Values) -> Any:
        header, payload = view_message(values.random, "camera/c1", 1)
        fields = {n: getattr(header, n) for n in ("source", "view", "seq", "camera", "image", "depth", "depth_range_m")}
        request = InferRequest(stamp_ns=clock_ns(), **fields, prompts=["tv"], texts=["a photo of a tv"])
        return decoded(InferRequest, values.like(request)), values.bytes_like(payload)

    def process(self, data: Any, values: Values) -> None:
        request, payload = data
        if values.random.random() < 0.2:
            check_texts(request)
            return
        check_view(request, payload, needs_prompts=values.random.random() < 0.5)
        pending = PendingRequest(request, payload)
        pending.decode()
        pending.job(clock_ns())


class Truths(Target):
    """Instance ids, layers and clouds: arrays beside a header that says how large they are."""

    name, share = "arrays: layers, clouds, instance ids", 12

    def input(self, values: Values) -> Any:
        kind = values.random.choice(("truth", "layer", "cloud"))
        if kind == "truth":
            ids = np.arange(24 * 32, dtype=np.uint16).reshape(24, 32) % 7
            truth = Truth(stamp_ns=1, source="camera/c1", view=0, seq=1, width_px=32, height_px=24, labels={1: "tv"})
            return kind, decoded(Truth, values.like(truth)), values.bytes_like(pack_array(ids))
        header, payload = layer_message(values, "cloud" if kind == "cloud" else values.random.choice(list(GRID_LAYERS)))
        return kind, decoded(LayerHeader, values.like(header)), values.bytes_like(payload)

    def process(self, data: Any, values: Values) -> None:
        kind, header, payload = data
        if kind == "truth":
            truth_from_wire(header, payload)
        elif kind == "cloud":
            gateway_layers.thinned_cloud(unpack_cloud(header, payload), 10)
        else:
            cells = unpack_layer(header.layer, header, payload)
            gateway_layers.render(header.layer, header.grid, cells)


def layer_array(values: Values, layer: str) -> np.ndarray:
    """Cells of a layer, some of which are odd."""
    random = np.random.default_rng(values.random.getrandbits(32))
    if layer == "cloud":
        cells = random.random((50, 6)).astype(np.float32)
    elif GRID_LAYERS[layer] == "uint8":
        cells = (random.random(GRID.shape) < 0.2).astype(np.uint8) * (255 if values.is_odd() else 1)
    else:
        cells = random.random(GRID.shape).astype(np.float32)
    if cells.dtype == np.float32:
        odd = values.random.choice((np.nan, np.nan, np.inf, -np.inf, 1e38, -1e38)) if values.is_odd() else np.nan
        cells.ravel()[:: 5 if layer == "value" else 10_000] = odd
        if values.is_odd():
            cells[:] = odd
    return cells


def layer_message(values: Values, layer: str) -> tuple[LayerHeader, bytes]:
    cells = layer_array(values, layer)
    header = LayerHeader(
        stamp_ns=clock_ns(),
        floor="0",
        layer=layer,  # type: ignore[arg-type]
        revision=3,
        grid=GRID,
        dtype=cells.dtype.name,  # type: ignore[arg-type]
        shape=cells.shape,
        target="tv" if layer == "value" else "",
    )
    return header, pack_array(cells)


class PlannerMaps(Target):
    """Maps and a robot's status, as the planner gets them, and the decision that it makes on them."""

    name, share = "planner: maps and a decision", 6

    def __init__(self) -> None:
        self._node = FedNode()
        self._config = PlannerConfig()
        warm_up(self._config)

    def input(self, values: Values) -> Any:
        parts, payload = [], b""
        for name in GRID_LAYERS:
            cells = layer_array(values, name)
            packed = pack_array(cells)
            parts.append(LayerPart(name, cells.dtype.name, cells.shape, len(packed)))  # type: ignore[arg-type]
            payload += packed
        header = FloorMapsHeader(
            stamp_ns=clock_ns(),
            floor="0",
            target="tv",
            epoch="a",
            revision=4,
            since=-1,
            grid=GRID,
            layers=parts,
            objects=[_CHAIR],
            object_ids=[1],
            robots={"r1": 3},
            pending_views=0,
        )
        revision = values.of(contract.MAP_REVISION.message)
        revision |= {"robots": {"r1": 3}, "floor": "0"} if not values.is_odd() else {}
        status = RobotStatus(
            stamp_ns=clock_ns(),
            robot="r1",
            floor="0",
            seq=3,
            state="moving",
            T_world_base=Pose.from_matrix(base_pose((1.0, 1.0, 0.0), 0.5)),
            mission="m1",
        )
        maps = received_of(contract.FLOOR_MAPS, values.like(header), values.bytes_like(payload), floor="0")
        said = decoded(RobotStatus, values.like(status) | {"stairs": values.of(list[Stair])})
        return maps, decoded(contract.MAP_REVISION.message, revision), said

    def process(self, data: Any, values: Values) -> bool:
        maps, revision, status = data
        self._node.answer = lambda *_: maps
        found = FloorMapsClient(self._node, "tv", 1.0).maps_at(revision, "r1")  # type: ignore[arg-type]
        if _fault_of(status):
            return False
        stairs = tuple(s for s in status.stairs if _is_stair(s))
        step(MissionState("tv"), found, RobotView.from_status(status, "m1", stairs), self._config)
        return True


class PlannerMissions(Target):
    """Goals, and what is said to missions and about them; no robot is there, so they wait."""

    name, share = "planner: missions", 8
    documented = (Refused, MissionError)

    def __init__(self) -> None:
        self._node = FedNode()
        self._node.present["perception"] = {"w1"}
        self._service = PlannerService(self._node, PlannerSettings(max_queued=20, finished_missions_kept=20))  # type: ignore[arg-type]
        self._summaries = Summaries(self._node)  # type: ignore[arg-type]

    def input(self, values: Values) -> Any:
        if values.random.random() < 0.3:
            stream = values.random.choice((contract.ROBOT_STATUS, contract.CAMERA_SUMMARY, contract.MAP_REVISION))
            made = values.of(stream.message)
            return "", received_of(stream, made), made, stream, ids_of(stream, values)
        name = values.random.choice([n for n in self._node.handlers if n.startswith("mission_")])
        stream = self._node.handlers[name][0]
        made = values.of(stream.request) if stream.request is not None else None
        if made is not None:
            decoded(stream.request, made)
        answers = {s.name: values.of(s.message) for s in (contract.PERCEPTION_TEXT, contract.PERCEPTION_LOAD)}
        return name, answers, made, stream, ids_of(stream, values)

    def process(self, data: Any, values: Values) -> None:
        name, answers, made, stream, ids = data
        if not name:
            self._node.deliver(stream, made, **ids)
        else:
            self._node.answer = lambda asked, _: received_of(asked, answers[asked.name], worker="w1")
            # missions without a robot never begin
            with patch.multiple(planner_service, _CANCEL_WAIT_S=0.0, _PAUSE_WAIT_S=0.0):
                self._node.query(name, made, b"", {}, **ids)
        self._summaries.by_floor()
        self._summaries.fresh_bytes()
        self._service.step()


class RobotRequests(Target):
    """Commands and halts to a robot, and requests to a camera."""

    name, share = "robot and camera: requests", 12
    documented = (Refused,)

    def __init__(self) -> None:
        self._robot, self._camera = FedNode(), FedNode()
        folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
        settings = RobotSettings(id="r1", store=str(folder / "robot.state"))
        self._service = RobotService(self._robot, _Body(), settings)  # type: ignore[arg-type]
        self._camera_service = CameraService(self._camera, _Source(), CameraSettings(id="c1"))  # type: ignore[arg-type]

    def input(self, values: Values) -> Any:
        node = values.random.choice((self._robot, self._camera))
        name = values.random.choice(list(node.handlers))
        stream = node.handlers[name][0]
        made = values.of(stream.request) if stream.request is not None else None
        if made is not None:
            decoded(stream.request, made)
        return node, name, made, ids_of(stream, values)

    def process(self, data: Any, values: Values) -> None:
        node, name, made, ids = data
        try:
            node.query(name, made, b"", {}, **ids)
        finally:
            if values.random.random() < 0.05:
                self._camera_service.step()
            with self._service._commands.acting:
                self._service._commands.check_deadline(0.0)


class _Body(ActionBody):
    """A robot that stands still."""

    stairs, notes = (), ()

    def __init__(self) -> None:
        self.state = RobotState(1.0, 1.0, 0.0, "0", 0.0)

    def refusal(self, action: str, to_floor: str | None = None) -> str:
        return "no stair leads there" if action == "take_stairs" else ""

    def begin_mission(self, mission: str) -> None:
        self.state = self.state.begin_mission(mission)

    def act(self, action: str, to_floor: str | None = None) -> None:
        self.state = dataclasses.replace(self.state, last_action=action, stopped=action == "stop")

    def halt(self) -> None:
        pass


class _Source:
    """A camera that always sees the same."""

    place = Place("c1", "0", (1.0, 1.0, 2.4), 2.4)
    views = (Pose.from_matrix(base_pose((1.0, 1.0, 2.4), 0.0)),)
    intrinsics, depth_range_m, has_depth = LENS, RANGE_M, True
    stream = StreamStatus()

    def version(self, view: int) -> int | None:
        return 1

    def latest(self, view: int) -> Picture:
        return Picture(1, *picture(Random(0)))

    def content(self, view: int) -> str:
        return ""


class GatewayState(Target):
    """Everything that the gateway follows, and the resources that it makes of it."""

    name, share = "gateway: what it follows", 8
    documented = (Problem,)
    _streams = (
        contract.MISSION_STATUS,
        contract.MISSION_PLAN,
        contract.JUDGED,
        contract.CAMERA_INFO,
        contract.CAMERA_SUMMARY,
        contract.ROBOT_STATUS,
        contract.PERCEPTION_LOAD,
        contract.MAP_REVISION,
        contract.MAP_REMOVALS,
        contract.RECORDER_STATUS,
        contract.SERVICES,
        contract.TRAFFIC,
        contract.REPLAY,
    )
    _present = {"camera": {"c1"}, "robot": {"r1"}, "perception": {"w1"}, "fusion": {"f1"}, "planner": {"p1"}}

    def __init__(self) -> None:
        self.node = FedNode()
        self.node.present.update(self._present)
        self.gateway = Gateway(self.node, GatewaySettings(port=0))  # type: ignore[arg-type]
        self._resources = self.gateway._live_resources()
        self._n = 0

    def input(self, values: Values) -> Any:
        stream = values.random.choice(self._streams)
        made = values.of(stream.message)
        received_of(stream, made)
        return stream, made, ids_of(stream, values)

    def process(self, data: Any, values: Values) -> None:
        stream, made, ids = data
        self._n += 1
        if self._n % 300 == 0:
            self.gateway._forget_everything()
        self.node.deliver(stream, made, **ids)
        for kind in values.random.sample(list(self._resources), 4):
            for resource in self._resources[kind]().values():
                _is_json(resource)
        if values.random.random() < 0.1:
            self.gateway._detector.compare()


class GatewayAnswers(Target):
    """What fusion, recorder and others answer to the gateway's questions."""

    name, share = "gateway: answers", 8
    documented = (Problem,)
    _asked = ("objects", "recordings", "view_picture", "camera_request", "camera_search")

    def __init__(self) -> None:
        self._state = GatewayState()
        revision = Values(Random(0))
        revision.odd = 0.0
        made = revision.of(contract.MAP_REVISION.message) | {"floor": "0"}
        self._state.node.deliver(contract.MAP_REVISION, made, floor="0")

    def input(self, values: Values) -> Any:
        kinds = ("objects", "object", "layer", "cloud", "recordings", "cameras", "sightings", "floors")
        what = values.random.choice(kinds)
        answers: dict[str, Received[Any]] = {}
        for stream in STREAMS:
            if stream.name == "map_layer":
                header, payload = layer_message(
                    values, "cloud" if what == "cloud" else values.random.choice(list(GRID_LAYERS))
                )
                ids = {"floor": "0", "layer": header.layer}
                answers[stream.name] = received_of(stream, values.like(header), values.bytes_like(payload), **ids)
            elif stream.name in self._asked:
                payload = values.bytes_like(b"\xff\xd8\xff\xd9")
                answers[stream.name] = received_of(stream, values.of(stream.message), payload, **ids_of(stream, values))
        return what, answers

    def process(self, data: Any, values: Values) -> None:
        what, answers = data
        gateway, node = self._state.gateway, self._state.node

        def answer(stream: Stream, _: Any) -> Received[Any]:
            if stream.name in answers:
                return answers[stream.name]
            return FedNode._nobody(stream, None)

        node.answer = answer
        for part in (gateway.maps, gateway.objects):
            part.clear()
        if what == "objects":
            for record in gateway.objects.records(ObjectFilter(None, None, None, 0.0), ""):
                _is_json(object_from_record(record))
        elif what == "object":
            _is_json(gateway.objects.one("0", 1))
            gateway.objects.picture("0", 1, 0)
        elif what == "layer":
            name = answers["map_layer"].message.layer
            for form in ("png", "npy"):
                gateway.maps.layer("0", name, "tv", form)
            _is_json(gateway.maps.place("0", name, "tv"))
        elif what == "cloud":
            gateway.maps.cloud("0", 20)
        elif what == "recordings":
            _is_json(gateway.recordings.page("", None, 0, 10))
        elif what == "cameras":
            gateway.cameras.thumbnail("c1", 0)
        elif what == "sightings":
            _is_json(gateway.sightings.search(SightingsRequest(target="tv", max_s=1.0)))
        else:
            for floor in gateway.maps.floors():
                _is_json(floor)


def _is_json(resource: Any) -> None:
    """The resource can be sent as JSON that every reader understands."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{type(resource).__name__} as JSON has {word}, which isn't JSON")

    json.loads(resource.model_dump_json(), parse_constant=refuse)


class Recorded(Target):
    """Messages of all streams, as the recorder writes them, for itself and for Foxglove."""

    name, share = "recorder: messages", 10
    _streams = tuple(s for s in STREAMS if "put" in s.kind or s.name in ("map_layer", "objects", "view_log"))

    def __init__(self) -> None:
        self._converter = FoxgloveConverter()

    def input(self, values: Values) -> Any:
        stream = values.random.choice(self._streams)
        if stream is contract.MAP_LAYER:
            header, payload = layer_message(values, values.random.choice((*GRID_LAYERS, "cloud")))
            return received_of(stream, values.like(header), values.bytes_like(payload), **ids_of(stream, values))
        made, payload = values.of(stream.message), b""
        if stream is contract.VIEW_LOG:
            source = values.random.choice(("robot/r1", "camera/c1"))
            header, payload = view_message(values.random, source, 1)
            made |= {"header": msgspec.msgpack.encode(values.like(header)), "source": source}
        return received_of(stream, made, values.bytes_like(payload), **ids_of(stream, values))

    def process(self, data: Any, values: Values) -> None:
        if values.random.random() < 0.003:
            self._converter = FoxgloveConverter()
        message = BusMessage(self._stream_of(data), data.key, data.message, data.payload, clock_ns())
        for written in self._converter.convert(message):
            if written.topic == data.key:
                assert decode_bus_message(message.stream, written.data) is not None

    @staticmethod
    def _stream_of(received: Received[Any]) -> Stream:
        return next(s for s in STREAMS if s.ids_of(received.key) is not None)
