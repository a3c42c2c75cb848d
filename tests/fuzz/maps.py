"""Targets of fusion: views, the messages that it follows, and the queries that it answers."""

from __future__ import annotations

import math
from random import Random
from types import SimpleNamespace
from typing import Any, get_args
from unittest.mock import patch

import msgspec
import numpy as np

from surveilnav import contract
from surveilnav.bus import Received, Refused, Request, clock_ns
from surveilnav.errors import SurveilNavError
from surveilnav.geometry import Pinhole, Pose, base_pose, camera_pose
from surveilnav.messages import (
    CameraInfo,
    CameraViewInfo,
    FrameHeader,
    InferReply,
    ModelIds,
    Observation,
    RobotStatus,
    Tier,
    WorkerLoad,
)
from surveilnav.sensing.packing import decode_frame, pack_embedding
from surveilnav.sensing.perceived import perceived_reply
from surveilnav.sensing.replies import perception_from_wire, perception_to_wire
from surveilnav.sensing.tiers import Seen, encode_view
from surveilnav.sensing.views import DetectedObject, ViewPerception
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core.snapshot import digest, dump, freeze
from surveilnav.services.fusion.core.snapshot import load as load_snapshot
from surveilnav.services.fusion.core.warm_up import warm_up
from surveilnav.services.fusion.map_log import removals
from surveilnav.services.fusion.service import FusionService
from tests.fuzz.node import FedNode, decoded, received_of
from tests.fuzz.target import Target
from tests.fuzz.values import Values

LENS = Pinhole.from_hfov(32, 24, math.radians(79))
RANGE_M = (0.1, 10.0)
_EMBEDDING = np.eye(8, dtype=np.float32)[0]
_TV = DetectedObject("tv", 0.9, (10.0, 8.0, 22.0, 18.0), np.ones((10, 12), np.bool_), _EMBEDDING, 0.8)
_SEEN = Seen(ViewPerception("test", (_TV,), _EMBEDDING, "e1", ("tv", "bed")), ModelIds(embedder="e1"))
#: Small maps of large cells, so that they are quickly compared.
_SMALL = {"extent_m": 6.0, "max_extent_m": 40.0, "resolution_m": 0.25, "voxel_m": 0.2}
#: The maps are compared before and after this share of views.
_COMPARED = 0.1
#: The maps begin anew after so many views that they took: they would grow for ever.
_FRESH_AFTER = 400


def picture(random: Random) -> tuple[np.ndarray, np.ndarray]:
    """Colour and depth [m] of a wall with a box before it."""
    depth_m = np.full((24, 32), random.uniform(1.0, 5.0), np.float32)
    depth_m[8:18, 10:22] *= 0.7
    depth_m[16:] = np.linspace(2.0, 0.9, 8, dtype=np.float32)[:, None]
    rgb = np.full((24, 32, 3), random.randrange(256), np.uint8)
    return rgb, depth_m


def view_message(random: Random, source: str, seq: int) -> tuple[FrameHeader, bytes]:
    """A picture of a robot or a camera, as it travels."""
    is_robot = source.startswith("robot/")
    tier: Tier = "jpeg+depth" if is_robot else random.choice(get_args(Tier))
    encoded = encode_view(tier, *picture(random), LENS, depth_range_m=RANGE_M, seen=_SEEN)
    height_m = 0.88 if is_robot else 2.4
    x_m, y_m, yaw = 2.0 + 0.01 * (seq % 50), 2.0, random.uniform(-3, 3)
    T = camera_pose((x_m, y_m, height_m), yaw, 0.0 if is_robot else -0.5)
    fields: dict[str, Any] = {
        "stamp_ns": clock_ns() - 10**9,
        "source": source,
        "view": 0 if is_robot else random.randrange(2),
        "seq": seq,
        "floor": "0",
        "T_world_camera": Pose.from_matrix(T),
        "camera": LENS,
        "mounting_offset_m": height_m,
        "depth_range_m": RANGE_M,
        "image": encoded.image,
        "depth": encoded.depth,
        "tier": tier,
        "perceived": encoded.perceived,
    }
    payload = encoded.payload
    if is_robot:
        return Observation(**fields, T_world_base=Pose.from_matrix(base_pose((x_m, y_m, 0.0), yaw))), payload
    fields["depth_source"] = random.choice(("sensor", "sensor", "network", "none"))
    return FrameHeader(**fields), payload


def reply_to(header: FrameHeader) -> InferReply:
    """What a worker would answer about a view."""
    detections, image = perception_to_wire(_SEEN.perception)
    return InferReply(
        stamp_ns=clock_ns(),
        worker="w1",
        backend="test",
        source=header.source,
        view=header.view,
        seq=header.seq,
        detections=detections,
        image_embedding=image,
    )


class Fusion:
    """A fusion service that is fed, with a camera, a robot and a perception worker that it knows."""

    def __init__(self) -> None:
        self.node = FedNode()
        self.node.present["perception"] = {"w1"}
        settings = FusionSettings(prompts=[], retry_s=0.001, map=_SMALL)
        self.service = FusionService(self.node, settings)  # type: ignore[arg-type]
        self.maps, self.intake = self.service._maps, self.service._intake
        self.perception = self.intake._perception
        self.empty = self.maps.freeze()
        self.reply: Received[Any] | SurveilNavError = SurveilNavError("nobody was asked")
        workers = SimpleNamespace(ask=self._answer, embedder="e1", needs_words=False, open_vocabulary=True)
        self.perception._workers = workers  # type: ignore[assignment]
        self.intake.texts._workers = workers  # type: ignore[assignment]
        self.n_taken = 0
        self.announce()
        warm_up(settings.core())

    def _answer(self, *_: Any, **__: Any) -> Received[Any]:
        if isinstance(self.reply, SurveilNavError):
            raise self.reply
        return self.reply

    def announce(self) -> None:
        """The camera and the robot say where they are."""
        views = [CameraViewInfo(v, Pose.from_matrix(camera_pose((2.0, 2.0, 2.4), v, -0.5))) for v in (0, 1)]
        info = CameraInfo(
            stamp_ns=clock_ns(),
            camera="c1",
            floor="0",
            position_m=(2.0, 2.0, 2.4),
            mounting_offset_m=2.4,
            intrinsics=LENS,
            views=views,
        )
        status = RobotStatus(
            stamp_ns=clock_ns(),
            robot="r1",
            floor="0",
            seq=1,
            state="ready",
            T_world_base=Pose.from_matrix(base_pose((2.0, 2.0, 0.0), 0.0)),
        )
        load = WorkerLoad(
            stamp_ns=clock_ns(), worker="w1", backend="test", why="", queued=0, capacity=8, latency_ms=1.0
        )
        self.node.deliver(contract.CAMERA_INFO, plain(info), floor="0", camera="c1")
        self.node.deliver(contract.ROBOT_STATUS, plain(status), robot="r1")
        self.node.deliver(contract.PERCEPTION_LOAD, plain(load), worker="w1")

    def digest(self) -> str:
        """Of what the maps hold. What is remembered of views that were refused isn't part of it."""
        maps = freeze(self.maps.joint)
        remembered = dict.fromkeys(("validator", "climbs", "quarantine"), 0)
        return digest({**maps, "maps": {**maps["maps"], **remembered}})

    def renew(self) -> None:
        """Begins with empty maps again."""
        self.maps.restore(self.empty)
        self.n_taken = 0


def plain(message: msgspec.Struct) -> Any:
    return msgspec.to_builtins(message, builtin_types=(bytes,))


class Frames(Target):
    """Frames of all tiers whose payloads were tampered with, decoded."""

    name, share = "frames", 20

    def input(self, values: Values) -> tuple[FrameHeader, bytes]:
        header, payload = view_message(values.random, "camera/c1", 1)
        spoilt = bytearray(payload)
        for _ in range(values.random.randrange(1, 4)):
            spoilt[values.random.randrange(len(spoilt))] = values.random.randrange(256)
        cut = values.random.choice((0, 0, 0, 1, values.random.randrange(len(spoilt))))
        return header, bytes(spoilt[: len(spoilt) - cut])

    def process(self, data: Any, values: Values) -> None:
        header, payload = data
        view = decode_frame(header, payload)
        depth_m, (near_m, far_m) = view.depth_m[view.depth_m != 0], RANGE_M
        assert ((depth_m > 0.99 * near_m) & (depth_m < 1.01 * far_m)).all(), "a depth out of the sensor's range"
        if (reply := perceived_reply(header, payload)) is not None:
            perception_from_wire(reply, header.camera)


class Views(Target):
    """Pictures and perception's answers about them, into the maps."""

    name, share = "fusion: views", 20

    def __init__(self, fusion: Fusion) -> None:
        self._fusion, self._seq, self.n_compared = fusion, 0, 0

    def input(self, values: Values) -> tuple[Received[Any], Received[Any]]:
        self._seq += 1
        source = values.random.choice(("robot/r1", "robot/r1", "camera/c1"))
        header, payload = view_message(values.random, source, self._seq)
        frame, kind = values.like(header), source.partition("/")
        payload = values.bytes_like(payload)
        if values.is_odd():  # with a header that says how long its parts now are
            n_image = min(header.image.n_bytes, len(payload) - 1)
            frame["image"], frame["depth"], frame["perceived"] = (
                {"encoding": "jpeg", "n_bytes": n_image},
                {"encoding": "depth-invq-zstd", "n_bytes": len(payload) - n_image},
                None,
            )
        ids = {"robot": kind[2]} if kind[0] == "robot" else {"floor": "0", "camera": kind[2], "view": str(header.view)}
        stream = contract.ROBOT_OBSERVATION if kind[0] == "robot" else contract.CAMERA_FRAME
        received = received_of(stream, frame, payload, **ids)
        answer = values.like(reply_to(header))
        return received, received_of(contract.PERCEPTION_INFER, answer, worker="w1")

    def process(self, data: Any, values: Values) -> bool:
        fusion, (frame, fusion.reply) = self._fusion, data
        source = (frame.ids.get("robot") and f"robot/{frame.ids['robot']}") or f"camera/{frame.ids['camera']}"
        sources = fusion.intake._sources
        if not sources._belongs(frame, source, int(frame.ids.get("view", 0))):
            return False
        frame = sources._by_our_clock(frame)
        if sources.wrong_intrinsics(frame.message):
            return False
        fusion.intake.positions.record(frame.message)
        fusion.intake._pictures.put(frame)
        lane = fusion.perception._robots if source.startswith("robot/") else fusion.perception._cameras
        perceived = fusion.perception._try_to_perceive(lane, frame)
        if perceived is None:
            return False
        revision = fusion.maps.joint.revision
        before = fusion.digest() if values.random.random() < _COMPARED else ""
        fusion.service._log.integrate([perceived])
        fusion.service._revisions.publish()
        is_taken = fusion.maps.joint.revision > revision
        if before and not is_taken:
            assert fusion.digest() == before, f"a refused view is in the maps: {perceived.fault or frame.message}"
            self.n_compared += 1
        fusion.n_taken += is_taken
        if fusion.n_taken >= _FRESH_AFTER:
            self.check()
            fusion.renew()
        return is_taken

    def check(self) -> None:
        """The maps can be stored and read again, and hold nothing that isn't a number."""
        joint = self._fusion.maps.joint
        data = dump(joint)
        assert dump(load_snapshot(data, joint.config)) == data
        for floor in joint.floors:
            assert np.isfinite(joint.layer(floor, "cloud")[1]).all(), "the cloud has a point that is nowhere"
            for record in joint.objects(floor):
                assert np.isfinite([*record.center_m, *record.size_m, record.confidence]).all(), record
                msgspec.msgpack.encode(record)


class FusionTables(Target):
    """What cameras, robots, workers and missions say of themselves, and a turn of fusion's loop."""

    name, share = "fusion: what it follows", 8
    _streams = (contract.CAMERA_INFO, contract.ROBOT_STATUS, contract.PERCEPTION_LOAD, contract.MISSION_STATUS)

    def __init__(self) -> None:
        self._fusion = Fusion()

    def input(self, values: Values) -> tuple[Any, Any, dict[str, str]]:
        stream = values.random.choice(self._streams)
        ids = {"floor": "0", "camera": "c1", "robot": "r1", "worker": "w1", "mission": "m1"}
        made = values.of(stream.message)
        received_of(stream, made)
        return stream, made, {k: v for k, v in ids.items() if k in stream.fields}

    def process(self, data: Any, values: Values) -> None:
        stream, made, ids = data
        fusion = self._fusion
        fusion.node.present["planner"] = {"p1"}
        fusion.node.deliver(stream, made, **ids)
        fusion.intake._sources._refreshed_s = 0.0
        fusion.service.step()
        fusion.intake._workers.embedder  # noqa: B018  # asks the loads
        fusion.perception.words()


class FusionQueries(Target):
    """Queries with any parameters, of maps that hold something."""

    name, share = "fusion: queries", 10
    documented = (Refused,)
    _numbers = ("0", "1", "7", "-1", "9" * 15, "9" * 5000, "１", "", "x", "1e3", "0x10", " 1", "nan")

    def __init__(self) -> None:
        self._fusion = Fusion()
        self._fusion.reply = received_of(contract.PERCEPTION_TEXT, plain(_text_reply()), worker="w1")
        fill(self._fusion)
        self._names = [n for n in self._fusion.node.handlers if n not in ("camera_search", "remove_from_maps")]

    def input(self, values: Values) -> Any:
        name = values.random.choice(self._names)
        stream, _ = self._fusion.node.handlers[name]
        made = values.of(stream.request) if stream.request is not None else None
        if stream.request is not None:
            decoded(stream.request, made)
        words = ("epoch", "since", "target", "text", "object", "history", "detail", "source", "view", "seq", "after")
        keys = values.random.sample((*words, "offset", "number", "only"), values.random.randrange(5))
        known = {"epoch": self._fusion.maps.epoch, "source": "camera/c1", "only": "digest", "history": "all"}
        parameters = {key: known[key] if key in known and not values.is_odd() else self._text(values) for key in keys}
        return name, made, {f: self._id(values, f) for f in stream.fields}, parameters

    def _text(self, values: Values) -> str:
        return values.of(str) if values.is_odd() else values.random.choice(self._numbers)

    @staticmethod
    def _id(values: Values, field: str) -> str:
        return values.random.choice(("0", "0", "1", "elsewhere", "occupancy", "value", "cloud", "provenance"))

    def process(self, data: Any, values: Values) -> None:
        name, made, ids, parameters = data
        if values.random.random() < 0.1:
            ids = {}
        self._fusion.node.query(name, made, b"", parameters, **ids)


class Searches(Target):
    """Searches with cameras, and removals from maps, as requests."""

    name, share = "fusion: requests", 3
    documented = (Refused,)

    def __init__(self) -> None:
        self._fusion = Fusion()
        fill(self._fusion)

    def input(self, values: Values) -> Any:
        stream = values.random.choice((contract.CAMERA_SEARCH, contract.REMOVE_FROM_MAPS))
        made = values.of(stream.request)
        if stream is contract.CAMERA_SEARCH:
            made["max_s"] = values.random.choice((0.0, -1.0, float("nan"), float("-inf")))
        else:
            made["source"] = values.random.choice(("camera/nobody", "robot/", "camera/../r", made["source"], "x" * 999))
        made["rooms"] = made.get("rooms", [])[:20]  # many rooms only take time
        made = {name: value for name, value in made.items() if name in stream.request.__struct_fields__}
        decoded(stream.request, made)
        return stream.name, made

    def process(self, data: Any, values: Values) -> None:
        with patch.object(removals, "_ANSWER_S", 0.0):  # the turn of the loop that answers comes only afterwards
            self._fusion.node.query(data[0], data[1], b"", {}, fusion="f1")
        self._fusion.service.step()


def fill(fusion: Fusion, n: int = 6) -> None:
    """Puts some healthy views into the maps."""
    views, values = Views(fusion), Values(Random(0))
    kept = fusion.reply
    while fusion.maps.joint.revision < n:
        values.odd = 0.0
        views.process(views.input(values), values)
    fusion.reply = kept


def _text_reply() -> Any:
    from surveilnav.messages import ModelIds, TextReply

    return TextReply(
        stamp_ns=clock_ns(),
        worker="w1",
        backend="test",
        embeddings=[pack_embedding(_EMBEDDING)],
        words=["tv"],
        models=ModelIds(embedder="e1"),
    )


class Texts(Target):
    """Embeddings of texts, as workers answer them, and value layers by them."""

    name, share = "fusion: embeddings of texts", 6
    documented = (Refused,)

    def __init__(self) -> None:
        self._fusion = Fusion()
        fill(self._fusion)

    def input(self, values: Values) -> Any:
        return received_of(contract.PERCEPTION_TEXT, values.like(_text_reply()), worker="w1")

    def process(self, data: Any, values: Values) -> None:
        self._fusion.reply = data
        texts = self._fusion.intake.texts
        texts._cache.clear()
        embedding = texts.encode("a photo of a tv")
        with self._fusion.maps.lock:
            self._fusion.maps.joint.layer("0", "value", embedding.vector, embedding.model)
        request = Request({"floor": "0"}, {"text": "tv"}, None, b"", clock_ns())
        self._fusion.node.handlers["objects"][1](request)
