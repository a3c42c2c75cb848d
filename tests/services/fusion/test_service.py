"""The fusion service over real Zenoh, among robots, cameras and workers made of a few lines."""

from __future__ import annotations

import math
import os
import random
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace

import cv2
import msgspec
import numpy as np
import pytest

from surveilnav import contract
from surveilnav.bus import Answer, Node, Refused, clock_ns
from surveilnav.geometry import Grid, Pinhole, Pose, base_pose
from surveilnav.messages import (
    Ack,
    CameraInfo,
    CameraViewInfo,
    FrameHeader,
    InferReply,
    ModelIds,
    Observation,
    RemoveFromMaps,
    RobotFrameProblem,
    RobotStatus,
    TextReply,
    WorkerLoad,
)
from surveilnav.robot_frame import PlanarTransform
from surveilnav.sensing.packing import (
    decode_frame,
    encode_rgbd,
    pack_embedding,
    unpack_array,
    unpack_embedding,
)
from surveilnav.sensing.replies import perception_from_wire, perception_to_wire
from surveilnav.sensing.tiers import Seen, encode_view
from surveilnav.sensing.views import DetectedObject, ViewPerception
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core import FusionConfig, JointMap
from surveilnav.services.fusion.core.views.robot_frames import FrameProblem
from surveilnav.services.fusion.core.warm_up import warm_up
from surveilnav.services.fusion.service import FusionService
from tests.waiting import patient, until

CAMERA = Pinhole.from_hfov(160, 120, math.radians(79))
RANGE_M = (0.1, 10.0)


def header_of(view, kind=FrameHeader, **more):
    payload, image, depth = encode_rgbd(view.rgb, view.depth_m, depth_range_m=RANGE_M)
    header = kind(
        stamp_ns=clock_ns(),
        source=view.source,
        view=view.view,
        seq=view.seq,
        floor=view.floor,
        camera=view.camera,
        T_world_camera=Pose.from_matrix(view.T_world_camera),
        mounting_offset_m=view.mounting_offset_m,
        depth_range_m=RANGE_M,
        **{"image": image, "depth": depth} | more,
    )
    return header, payload


class Robot:
    def __init__(self, node: Node, world) -> None:
        self.node, self.world, self.seq = node, world, 0
        self._status = node.publisher(contract.ROBOT_STATUS, robot="r")
        self._observation = node.publisher(contract.ROBOT_OBSERVATION, robot="r")
        node.serve(contract.ROBOT_STATUS, lambda _: Answer(self._state()), robot="r")

    def _state(self) -> RobotStatus:
        pose = Pose.from_matrix(base_pose((1, 2, 0), 0))
        return RobotStatus(stamp_ns=clock_ns(), robot="r", floor="0", seq=self.seq, state="ready", T_world_base=pose)

    def observe(self, yaw=0.0, floor="0", floor_z=0.0, spoil=None, x=1.0) -> int:
        self._status.put(self._state())
        until(lambda: self._observation.matched)
        self.seq += 1
        view = self.world.view(x, 2, yaw, -0.2, seq=self.seq, floor=floor, floor_z=floor_z)
        pose = Pose.from_matrix(base_pose((1, 2, floor_z), yaw))
        header, payload = header_of(view, Observation, T_world_base=pose)
        self.last = spoil(header, payload) if spoil else (header, payload)
        self.repeat()
        return self.seq

    def repeat(self) -> None:
        self._observation.put(*self.last)


class Camera:
    def __init__(self, node: Node, world, name: str, floor: str, floor_z: float, n_views: int = 2) -> None:
        self.node, self.name, self.floor = node, name, floor
        self.views = [
            world.view(
                5.5, 3.5, -2.4 + i, -0.5, height=1.8, source=f"camera/{name}", view=i, floor=floor, floor_z=floor_z
            )
            for i in range(n_views)
        ]
        self.frames = [node.publisher(contract.CAMERA_FRAME, floor=floor, camera=name, view=i) for i in range(n_views)]
        self.asked: list[list[int]] = []
        self.pictures: list[list[int]] = []
        self.encoded: dict = {}
        self.paused = False
        place = {"floor": floor, "camera": name}
        node.serve(contract.CAMERA_INFO, lambda _: Answer(self.info()), **place)
        node.serve(contract.CAMERA_REQUEST, self._on_request, **place)
        node.publisher(contract.CAMERA_INFO, **place).put(self.info())

    def info(self) -> CameraInfo:
        v = self.views[0]
        return CameraInfo(
            stamp_ns=clock_ns(),
            camera=self.name,
            floor=self.floor,
            position_m=tuple(v.T_world_camera[:3, 3].tolist()),
            mounting_offset_m=1.8,
            intrinsics=CAMERA,
            views=[CameraViewInfo(w.view, Pose.from_matrix(w.T_world_camera)) for w in self.views],
        )

    @property
    def invoked(self) -> bool:
        return any(p.matched for p in self.frames)

    def frame(self, view: int):
        return self.encoded.setdefault(view, header_of(self.views[view]))

    def send(self, view: int) -> None:
        self.frames[view].put(*self.frame(view))

    def _on_request(self, request) -> Answer:
        if self.paused:
            raise Refused("paused", "a person has paused it")
        (self.pictures if request.message.pictures else self.asked).append(list(request.message.views))
        if request.message.pictures:
            return Answer(Ack(stamp_ns=clock_ns()))
        for view in request.message.views:
            self.send(view)
        return Answer(Ack(stamp_ns=clock_ns()))


class Worker:
    """Sees a chair in the middle of every picture."""

    def __init__(self, node: Node) -> None:
        self.node, self.seen, self.texts, self.refuse, self.open_vocabulary = node, [], [], "", False
        self._load = node.publisher(contract.PERCEPTION_LOAD, worker="w")
        node.serve(contract.PERCEPTION_LOAD, lambda _: Answer(self._state()), worker="w")
        node.serve(contract.PERCEPTION_INFER, self._infer, worker="w")
        node.serve(contract.PERCEPTION_TEXT, self._text, worker="w")
        threading.Thread(target=self._say, daemon=True).start()

    def _say(self) -> None:
        while not self.node.stopping.wait(0.3):
            self._load.put(self._state())

    def _state(self) -> WorkerLoad:
        return WorkerLoad(
            stamp_ns=clock_ns(),
            worker="w",
            backend="fake",
            why="",
            queued=0,
            capacity=4,
            latency_ms=1.0,
            open_vocabulary=self.open_vocabulary,
        )

    def _infer(self, request) -> Answer:
        m = request.message
        self.seen.append((m.source, m.view, m.seq))
        if self.refuse:
            raise Refused(self.refuse, "not now")
        return Answer(self.reply(m.source, m.view, m.seq))

    def reply(self, source: str, view: int, seq: int) -> InferReply:
        look = np.eye(4, dtype=np.float32)
        chair = DetectedObject("chair", 0.8, (60.0, 60.0, 100.0, 110.0), None, look[0])
        detections, image = perception_to_wire(ViewPerception("fake", (chair,), look[seq % 4]))
        return InferReply(
            stamp_ns=clock_ns(),
            worker="w",
            backend="fake",
            source=source,
            view=view,
            seq=seq,
            detections=detections,
            image_embedding=image,
        )

    def _text(self, request) -> Answer:
        self.texts += request.message.texts
        embedding = pack_embedding(np.array([0.6, 0.8, 0, 0], np.float32))
        return Answer(TextReply(stamp_ns=clock_ns(), worker="w", backend="fake", embeddings=[embedding]))


class Scene:
    """A fusion service and its neighbours."""

    def __init__(self, make_node, world) -> None:
        self.make_node, self.world = make_node, world
        self.client = patient(make_node("test", "client", alive=False))
        self.revisions = self.client.table(contract.MAP_REVISION)
        self.robot = Robot(make_node("robot", "r", alive=False), world)

    def start(self, **settings) -> None:
        self.node = self.make_node("fusion", "fusion")
        self.service = FusionService(self.node, FusionSettings(**{"retry_s": 0.05, "resend_after_s": 0.3} | settings))
        threading.Thread(target=self.node.run, args=(self.service.step,), daemon=True).start()

    def worker(self) -> Worker:
        return Worker(self.make_node("perception", "w"))

    def camera(self, name="c", floor="0", floor_z=0.0) -> Camera:
        return Camera(self.make_node("camera", name, alive=False), self.world, name, floor, floor_z)

    def revision(self, floor="0"):
        row = self.revisions.get(floor=floor)
        return row.message if row else None

    def holds(self, seq: int, floor="0") -> bool:
        r = self.revision(floor)
        return bool(r) and r.robots.get("r") == seq

    def layer(self, name, floor="0", **parameters):
        got = self.client.ask(contract.MAP_LAYER, floor=floor, layer=name, parameters=parameters)
        return got.message, unpack_array(got.payload, got.message.dtype, got.message.shape)


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    """The loops of the maps, compiled before anybody waits for them."""
    warm_up(FusionConfig())


@pytest.fixture
def scene(make_node, world) -> Scene:
    return Scene(make_node, world)


def test_an_observation_becomes_maps_and_objects(scene):
    worker = scene.worker()
    scene.start()
    for i in range(3):
        seq = scene.robot.observe(yaw=0.3 * i)
        until(lambda seq=seq: scene.holds(seq))
    scene.robot.repeat()  # nobody followed up, it thinks
    header, explored = scene.layer("explored")
    assert isinstance(header.grid, Grid)
    assert explored.shape == header.grid.shape
    row, col = header.grid.cells_of((2.0, 2.0))
    assert explored[row, col] == 1
    _, value = scene.layer("value", target="potted plant")
    assert np.nanmax(value) == pytest.approx(0.8, abs=0.01)
    scene.layer("value", target="potted plant")
    assert worker.texts == ["seems like there is a potted plant"]  # asked once
    assert scene.layer("cloud")[1].shape[1] == 6
    objects = scene.client.ask(contract.OBJECTS, floor="0").message.objects
    assert {o.label for o in objects} == {"chair"}
    (every,) = scene.client.ask_all(contract.OBJECTS)
    brief = scene.client.ask(contract.OBJECTS, floor="0", parameters={"detail": "brief"}).message.objects
    assert brief == [msgspec.structs.replace(o, points=b"", history=[]) for o in objects] != objects
    assert every.ids["floor"] == "0"
    assert scene.client.ask(contract.MAP_REVISION, floor="0").message.robots == {"r": 3}
    assert scene.revision().revision == len(worker.seen) == 3


@pytest.mark.parametrize("worker", ["a/b", "nobody", "*", "w"])
def test_a_load_that_lies_steers_nothing(scene, worker):
    """A message that decodes, says that an impossible or absent worker is idle, and must be believed by nobody."""
    scene.worker()
    scene.start()
    liar = scene.make_node("stranger", "x", alive=False)
    publisher = liar.publisher(contract.PERCEPTION_LOAD, worker="nobody")
    until(lambda: publisher.matched)
    lie = WorkerLoad(
        stamp_ns=clock_ns(), worker=worker, backend="fake", why="", queued=-5, capacity=4, latency_ms=float("nan")
    )
    publisher.put(lie)
    for _ in range(3):
        seq = scene.robot.observe()
        until(lambda seq=seq: scene.holds(seq))
        publisher.put(lie)


def test_only_the_cameras_of_the_robots_floor_are_invoked_and_asked_once(scene):
    worker, here, upstairs = scene.worker(), scene.camera("here"), scene.camera("up", "1", 2.8)
    scene.start(linger_s=0.2)
    scene.robot.observe()
    until(lambda: here.invoked)
    here.send(0)
    until(lambda: any(c.camera == "here" and c.views_processed for c in scene.revision().cameras))
    here.send(0)  # the same picture again
    until(lambda: here.asked)  # view 1 never came: fusion asks for it
    assert here.asked[0] == [1]
    revision = until(lambda: (r := scene.revision()) and r.pending_views == 0 and r)
    assert [(c.camera, c.views_processed, c.views) for c in revision.cameras] == [("here", 2, 2)]
    assert not upstairs.invoked
    asked = [s for s in worker.seen if s[0].startswith("camera/")]
    assert sorted(asked) == [("camera/here", 0, 0), ("camera/here", 1, 0)]
    scene.robot.observe(floor="1", floor_z=2.8)  # the robot goes upstairs
    until(lambda: upstairs.invoked and not here.invoked)
    until(lambda: (r := scene.revision()) and not r.cameras and not r.robots)


def seen_by_camera(view, words=("chair", "tv")):
    """A frame of a camera that looks by itself, and sees a chair in the middle of every picture."""
    look = np.eye(4, dtype=np.float32)
    chair = DetectedObject("chair", 0.8, (60.0, 60.0, 100.0, 110.0), None, look[0])
    seen = Seen(ViewPerception("its own", (chair,), look[1], "", words), ModelIds())
    encoded = encode_view("features", view.rgb, view.depth_m, view.camera, depth_range_m=RANGE_M, seen=seen)
    header, _ = header_of(view, image=encoded.image, depth=encoded.depth, tier="features", perceived=encoded.perceived)
    return header, encoded.payload


def test_what_a_camera_sees_itself_goes_into_the_maps_without_asking_perception(scene):
    worker, camera = scene.worker(), scene.camera()
    camera.encoded = {v: seen_by_camera(camera.views[v]) for v in (0, 1)}
    scene.start()
    scene.robot.observe()
    until(lambda: camera.invoked)
    camera.send(0)
    until(lambda: any(c.views_processed for c in scene.revision().cameras))
    assert [s for s in worker.seen if s[0].startswith("camera/")] == []
    found = scene.client.ask(contract.OBJECTS, floor="0").message.objects
    assert any("camera/c" in {h.source for h in o.history} for o in found)


@pytest.mark.parametrize("open_vocabulary", [True, False])
def test_pictures_are_wanted_of_a_camera_that_didnt_look_for_what_is_searched(scene, open_vocabulary):
    worker, camera = scene.worker(), scene.camera()
    worker.open_vocabulary = open_vocabulary
    camera.encoded = {v: seen_by_camera(camera.views[v]) for v in (0, 1)}
    scene.start(prompts=["shelf"])
    scene.robot.observe()
    until(lambda: camera.invoked)
    camera.send(0)
    camera.send(1)
    until(lambda: (r := scene.revision()) and r.cameras and r.pending_views == 0)
    assert camera.pictures == [], "for words that are only looked for in passing, no pictures are sent"
    with scene.service._intake.searches.open("ladder", None):
        until(lambda: {0, 1} <= {v for views in camera.pictures for v in views})
        until(lambda: scene.revision().pending_views == 2)
        camera.encoded = {}
        camera.send(0)
        camera.send(1)
        until(lambda: {("camera/c", 0, 0), ("camera/c", 1, 0)} <= set(worker.seen))
        until(lambda: scene.revision().pending_views == 0)


def test_surveillance_can_be_switched_off(scene):
    scene.worker()
    camera = scene.camera()
    scene.start(surveillance=False)
    seq = scene.robot.observe()
    until(lambda: scene.holds(seq))
    assert not camera.invoked
    assert scene.revision().cameras == []


def test_a_view_that_perception_can_not_tell_about_is_taken_without_detections_and_named(scene):
    worker = scene.worker()
    reply = worker.reply
    worker.reply = lambda *view: msgspec.structs.replace(
        reply(*view), image_embedding=b""
    )  # decodes, and is no embedding
    scene.start()
    seq = scene.robot.observe()
    until(lambda: scene.holds(seq))
    assert len(worker.seen) == 3
    assert scene.node.traffic.rejected() == {"view.not_perceived": 1}
    assert scene.client.ask(contract.OBJECTS, floor="0").message.objects == []


def test_an_observation_waits_for_perception_to_come_back(scene):
    scene.start()
    seq = scene.robot.observe()
    down = until(lambda: (r := scene.revision()) and not r.perception_ok and r)
    assert "perception is down" in down.message
    assert down.robots == {}
    with pytest.raises(Refused, match="without perception"):
        scene.layer("value", target="bed")
    worker = scene.worker()
    until(lambda: scene.holds(seq))
    assert until(lambda: scene.revision().perception_ok)
    worker.refuse = "busy"
    seq = scene.robot.observe(yaw=1.0)
    until(lambda: len(worker.seen) >= 6)
    assert not scene.holds(seq)
    worker.refuse = ""
    until(lambda: scene.holds(seq))


def test_a_picture_that_perception_never_takes_is_geometry_all_the_same(scene):
    worker = scene.worker()
    worker.refuse = "perception_failed"
    scene.start()
    seq = scene.robot.observe()
    until(lambda: scene.holds(seq))
    assert len(worker.seen) == 3
    assert scene.layer("explored")[1].any()


def test_straight_down_no_detector_is_asked(scene, world):
    worker, camera = scene.worker(), scene.camera()
    camera.views[0] = world.view(5, 3, 0, -math.pi / 2, height=1.8, source="camera/c")
    scene.start()
    scene.robot.observe()
    until(lambda: camera.invoked)
    camera.send(0)
    until(lambda: any(c.views_processed for c in scene.revision().cameras))
    assert not [s for s in worker.seen if s[:2] == ("camera/c", 0)]


def test_malformed_frames_are_counted_and_dropped(scene):
    import msgspec

    scene.worker()
    scene.start()
    replace = msgspec.structs.replace
    spoils = [
        lambda h, p: (replace(h, source="robot/other"), p),
        lambda h, p: (replace(h, floor="../etc"), p),
        lambda h, p: (h, p[:-9]),
        lambda h, p: (replace(h, mounting_offset_m=math.nan), p),
        lambda h, p: (replace(h, T_world_camera=Pose((9e5, 0.0, 0.9), (0.0, 0.0, 0.0, 1.0))), p),
    ]
    seq = scene.robot.observe()
    until(lambda: scene.holds(seq))
    for i, spoil in enumerate(spoils):
        scene.robot.observe(spoil=spoil)
        until(lambda i=i: sum(scene.node.traffic.rejected().values()) > i)
    seq = scene.robot.observe(yaw=0.5)
    until(lambda: scene.holds(seq))


@pytest.mark.parametrize(
    ("layer", "parameters", "name"),
    [("explored", {}, "unknown_floor"), ("beauty", {}, "unknown_layer"), ("value", {}, "bad_target")],
)
def test_what_cannot_be_answered_is_refused_by_name(scene, layer, parameters, name):
    scene.start()
    with pytest.raises(Refused) as refused:
        scene.layer(layer, **parameters)
    assert refused.value.name == name


# --- what is wrong with views, and what follows ---------------------------------------------------------------------


def rejected(scene) -> dict[str, int]:
    return {k: n for k, n in scene.node.traffic.rejected().items() if k.startswith("view.")}


def test_a_refused_view_is_counted_by_name_held_empty_and_told_of(scene):
    scene.worker()
    scene.start()
    seq = scene.robot.observe()
    until(lambda: scene.holds(seq))
    before = scene.layer("explored")[1].tobytes()
    seq = scene.robot.observe(x=4.5)  # 3.5 m in one step
    until(lambda: scene.holds(seq))
    assert scene.revision().revision == 1
    assert "pose_jump" in scene.revision().message
    assert scene.layer("explored")[1].tobytes() == before
    assert rejected(scene) == {"view.pose_jump": 1}
    seq = scene.robot.observe(x=4.6)  # it stands by it: it was relocalised
    until(lambda: scene.holds(seq) and scene.revision().revision == 2)
    assert until(lambda: scene.revision().message == "")
    scene.robot.seq += 3  # three never came
    seq = scene.robot.observe(x=4.6)
    until(lambda: scene.holds(seq))
    scene.robot.repeat()
    seq = scene.robot.observe(x=4.6, yaw=0.3)
    until(lambda: scene.holds(seq))
    assert scene.revision().revision == 4
    assert rejected(scene) == {"view.pose_jump": 1, "view.missing_seq": 1}


def test_a_robot_that_sees_nothing_from_the_start_gets_empty_maps(scene):
    """Close before a wall no pixel has a depth: the planner must be able to turn the robot round."""
    scene.worker()
    scene.start()

    def blind(header, payload):
        rgb = np.zeros((120, 160, 3), np.uint8)
        payload, image, depth = encode_rgbd(rgb, np.zeros((120, 160)), depth_range_m=RANGE_M)
        return msgspec.structs.replace(header, image=image, depth=depth), payload

    seq = scene.robot.observe(spoil=blind)
    until(lambda: scene.holds(seq))
    assert rejected(scene) == {"view.no_depth": 1}
    for layer in ("occupancy", "explored", "frontier"):
        header, array = scene.layer(layer)
        assert not array.any()
    assert [int(i) for i in header.grid.cells_of((1.0, 2.0))] == [array.shape[0] // 2, array.shape[1] // 2]
    assert np.isnan(scene.layer("value", target="bed")[1]).all()
    assert scene.client.ask(contract.OBJECTS, floor="0").message.objects == []


def test_a_camera_whose_frames_are_not_its_own_is_refused_before_perception(scene, world):
    worker, camera = scene.worker(), scene.camera()
    narrow = Pinhole.from_hfov(160, 120, math.radians(60))
    camera.views[1] = world.view(5, 3, 0, -0.5, height=1.8, source="camera/c", view=1, camera=narrow)
    scene.start()
    scene.robot.observe()
    until(lambda: camera.invoked)
    camera.send(0)
    camera.send(1)
    until(lambda: (r := scene.revision()) and r.cameras and r.cameras[0].views_processed == 2)
    assert "wrong_intrinsics" in scene.revision().message
    assert rejected(scene) == {"view.wrong_intrinsics": 1}
    assert [s for s in worker.seen if s[0] == "camera/c"] == [("camera/c", 0, 0)]


def test_a_wrongly_described_camera_is_put_into_quarantine_and_shown(scene):
    scene.worker()
    camera = scene.camera()
    turned = np.diag([1.0, -1.0, -1.0, 1.0])
    camera.views = [replace(v, T_world_camera=v.T_world_camera @ turned) for v in camera.views]
    scene.start()
    scene.robot.observe()
    until(lambda: camera.invoked)
    camera.send(0)
    camera.send(1)
    until(lambda: (r := scene.revision()) and r.cameras and r.cameras[0].views_processed == 2)
    until(lambda: "axes" in scene.revision().cameras[0].quarantine, lambda: scene.revision())
    assert rejected(scene) == {"view.geometry_disagrees": 2}


def test_a_robot_that_isnt_where_it_says_is_named_in_the_revision(scene):
    scene.worker()
    scene.start()
    problem = FrameProblem("robot r isn't where it says", PlanarTransform(0.5), 0.5, 0.0, 0.0)
    seq = scene.robot.observe()
    until(lambda: scene.holds(seq))
    assert scene.revision().frames == []
    scene.service._maps.joint.quarantine.frames.problems = lambda: {"robot/r": problem, "robot/elsewhere": problem}
    until(lambda: scene.revision().frames)
    assert scene.revision().frames == [RobotFrameProblem("r", "robot r isn't where it says", 0.5, 0.0, 0.0)]


def test_a_robot_on_the_stairs_takes_its_cameras_along(scene):
    """Up a stair whose altitude is estimated badly: the lower cameras go, the upper ones come, and none comes back."""
    scene.worker()
    below, above = scene.camera("below"), scene.camera("above", "1", 2.8)
    scene.start(linger_s=0.0)
    invoked = {"below": 0, "above": 0}
    was = dict.fromkeys(invoked, False)
    for z in (0.0, 0.3, 0.45, 0.38, 0.5, 0.41, 0.9, 1.4, 1.9, 2.35, 2.45, 2.35, 2.5, 2.8):
        seq = scene.robot.observe(floor_z=z, floor="0" if z < 2 else "1")
        until(lambda seq=seq: any(r.message.robots.get("r") == seq for r in scene.revisions.rows()))
        time.sleep(0.25)  # two looks at who is near
        for camera in (below, above):
            invoked[camera.name] += camera.invoked and not was[camera.name]
            was[camera.name] = camera.invoked
    assert invoked == {"below": 1, "above": 1}
    assert was == {"below": False, "above": True}


# --- durability -----------------------------------------------------------------------------------------------------


class Process:
    """Fusion as a process of its own, that can be killed."""

    def __init__(self, bus, path, **settings) -> None:
        self.environment = os.environ | {
            "SURVEILNAV_BUS__ROUTER": bus.router,
            "SURVEILNAV_BUS__BUILDING": bus.building,
            "SURVEILNAV_FUSION__STORE": str(path),
            "SURVEILNAV_FUSION__RESEND_AFTER_S": "0.3",
            **{f"SURVEILNAV_FUSION__{k.upper()}": str(v) for k, v in settings.items()},
        }
        self.log = open(path.with_suffix(".log"), "ab")  # noqa: SIM115
        self.start()

    def start(self) -> None:
        command = [sys.executable, "-m", "surveilnav.services.fusion"]
        self.process = subprocess.Popen(command, env=self.environment, stdout=self.log, stderr=self.log)

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


@pytest.fixture
def process(bus, tmp_path):
    started = []

    def start(**settings):
        started.append(Process(bus, tmp_path / "fusion.sqlite", **settings))
        return started[-1]

    yield start
    for p in started:
        p.kill()
        p.log.close()


@pytest.mark.slow
def test_kill_9_loses_nothing_that_was_acknowledged(scene, process, world):
    """Killed at random moments and started again, fusion ends with the maps of a run that nothing disturbed."""
    rng = random.Random(7)
    worker, camera = scene.worker(), scene.camera()
    fusion = process(snapshot_views=5)
    steady = JointMap()  # the undisturbed run, one view after the other

    def steadily(header, payload):
        reply = worker.reply(header.source, header.view, header.seq)
        steady.accept(decode_frame(header, payload), perception_from_wire(reply, CAMERA))

    def step(yaw: float, kill_after_s: float | None) -> None:
        seq = scene.robot.observe(yaw=yaw)
        if kill_after_s is not None:
            time.sleep(kill_after_s)
            acknowledged = scene.revision()
            fusion.kill()
            until(lambda: "fusion" not in scene.client.alive("fusion"), timeout_s=20)
            fusion.start()
            kept = until(lambda: ask_revision(scene), timeout_s=60)
            assert kept.revision >= acknowledged.revision
            assert all(kept.robots.get(r, -1) >= n for r, n in acknowledged.robots.items())
            processed = {c.camera: c.views_processed for c in acknowledged.cameras}

            def restored():
                scene.robot.repeat()  # as robots do until somebody follows it up
                time.sleep(0.2)
                return (r := ask_revision(scene)) and r.cameras and r

            assert all(c.views_processed >= processed[c.camera] for c in until(restored, timeout_s=20).cameras)
        until(lambda: scene.holds(seq), timeout_s=60)
        steadily(*scene.robot.last)

    scene.client.alive("fusion")
    step(0.0, None)
    until(lambda: camera.invoked, timeout_s=20)
    for view in (0, 1):
        camera.send(view)
        until(
            lambda view=view: (r := scene.revision()) and r.cameras and r.cameras[0].views_processed > view,
            timeout_s=20,
        )
        steadily(*camera.frame(view))
    for i in range(1, 25):
        step(0.3 * i, rng.uniform(0.0, 0.12) if i % 5 == 0 else None)
    asked = [s for s in worker.seen if s[0] == "camera/c"]
    assert len(asked) == 2  # the cameras' pictures, sent again after every restart, weren't looked at again
    assert steady.revision == scene.revision().revision == 27
    text = unpack_embedding(pack_embedding(np.array([0.6, 0.8, 0, 0], np.float32)))
    for name in ("occupancy", "explored", "frontier", "value"):
        grid, expected = steady.layer("0", name, text)
        header, array = scene.layer(name, **({"target": "bed"} if name == "value" else {}))
        assert (header.grid, header.revision) == (grid, 27)
        assert array.tobytes() == expected.tobytes(), name
    (_, cloud), (header, lines) = scene.layer("cloud"), scene.layer("provenance")
    expected, told = steady.layer("0", "cloud")[1], steady.layer("0", "provenance")[1]
    order, in_order = np.lexsort(cloud.T), np.lexsort(expected.T)  # they come in no particular order
    assert cloud[order].tobytes() == expected[in_order].tobytes()
    assert lines[order].tobytes() == told[in_order].tobytes()
    assert header.source_sets == steady.source_sets("0")
    assert scene.client.ask(contract.OBJECTS, floor="0").message.objects == steady.objects("0")


def ask_revision(scene):
    """What fusion says now, not what was heard last; None if it isn't there."""
    got = scene.client.ask_all(contract.MAP_REVISION, timeout_s=1.0)
    return next((r.message for r in got if r.message.floor == "0"), None)


def test_an_objects_whole_history_is_kept_and_served(scene, tmp_path):
    scene.worker()
    scene.start(store=str(tmp_path / "f.sqlite"), objects={"max_history": 3})
    for i in range(6):
        seq = scene.robot.observe(yaw=0.02 * i)
        until(lambda seq=seq: scene.holds(seq))
    (short,) = scene.client.ask(contract.OBJECTS, floor="0").message.objects
    assert len(short.history) == 3

    def ask(**parameters):
        return scene.client.ask(contract.OBJECTS, floor="0", parameters=parameters).message.objects

    (whole,) = ask(object=str(short.id))
    assert whole.history[-3:] == short.history
    assert [e.what for e in whole.history].count("created") == 1
    assert [e.seq for e in whole.history if e.what in ("created", "matched")] == [1, 2, 3, 4, 5, 6]
    assert ask(history="all") == [whole]
    seen = whole.history[-1]
    where = {"source": seen.source, "view": str(seen.view), "seq": str(seen.seq)}
    got = scene.client.ask(contract.VIEW_PICTURE, floor="0", parameters=where)
    assert (got.message.source, got.message.seq) == (seen.source, seen.seq)
    assert cv2.imdecode(np.frombuffer(got.payload, np.uint8), cv2.IMREAD_COLOR) is not None, "the JPEG and no more"
    for changed in ({"seq": "99"}, {"view": "x"}, {"seq": "-1"}, {"source": "robot/nobody"}, {"seq": "9" * 30}):
        with pytest.raises(Refused) as refused:
            scene.client.ask(contract.VIEW_PICTURE, floor="0", parameters=where | changed)
        assert refused.value.name == "unknown_picture"
    for wrong in ("99", "x", "-1"):
        with pytest.raises(Refused) as refused:
            ask(object=wrong)
        assert refused.value.name == "unknown_object"


def test_provenance_is_served_line_by_line_with_the_cloud(scene):
    scene.worker()
    scene.start()
    seq = scene.robot.observe()
    until(lambda: scene.holds(seq))
    (_, cloud), (header, lines) = scene.layer("cloud"), scene.layer("provenance")
    assert (lines.shape, lines.dtype) == ((len(cloud), 3), np.int64)
    assert {tuple(header.source_sets[i]) for i in lines[:, 0]} == {("robot/r",)}


def test_a_camera_that_was_moved_is_looked_through_again(scene, world):
    """Its new place is doubted once; the same picture, said again, is looked at again and believed."""
    worker, camera = scene.worker(), scene.camera()
    scene.start(resend_after_s=60.0)
    scene.robot.observe()
    until(lambda: camera.invoked)
    camera.send(0)
    until(lambda: (r := scene.revision()) and r.revision == 2)
    moved = {"height": 1.8, "source": "camera/c", "view": 0}
    for seq, revision in ((2, 2), (3, 3)):
        camera.views[0] = world.view(1.0, 1.0, 0.7, -0.5, seq=seq, **moved)
        camera.encoded.clear()
        camera.send(0)
        until(lambda seq=seq: ("camera/c", 0, seq) in worker.seen)
        until(
            lambda seq=seq, n=revision: bool(scene.revision().message) == (seq == 2) and scene.revision().revision == n
        )
    assert rejected(scene) == {"view.pose_jump": 1}


def test_while_the_disk_is_full_views_wait_where_there_is_room_for_few(scene, tmp_path):
    scene.worker()
    path = tmp_path / "f.sqlite"
    path.mkdir()  # nothing that can be written
    scene.start(store=str(path))
    scene.robot.observe()
    until(lambda: scene.service._log.is_blocked)
    seq = scene.robot.observe(yaw=0.1)
    until(lambda: scene.service._intake._perception._robots.done.qsize() == 1)
    path.rmdir()
    until(lambda: scene.holds(seq))
    assert scene.revision().revision == 2


def test_a_store_that_lost_events_does_not_shorten_a_history(scene, tmp_path):
    scene.worker()
    scene.start(store=str(tmp_path / "f.sqlite"))
    for i in range(4):
        if i == 3:
            scene.service._log._store.set_aside("lost")
        seq = scene.robot.observe(yaw=0.02 * i)
        until(lambda seq=seq: scene.holds(seq))
    (known,) = scene.client.ask(contract.OBJECTS, floor="0").message.objects
    (whole,) = scene.client.ask(contract.OBJECTS, floor="0", parameters={"object": str(known.id)}).message.objects
    assert whole.history == known.history
    assert [e.seq for e in whole.history if e.what in ("created", "matched")] == [1, 2, 3, 4]


def test_where_a_robot_stands_is_followed_on_the_last_floor_that_there_is_room_for(scene, monkeypatch):
    monkeypatch.setattr("surveilnav.services.fusion.intake.robot_positions._MAX_FLOORS", 1)
    scene.start()
    for x in (1.0, 1.5):
        scene.robot.observe(x=x)
        until(lambda x=x: (p := scene.service._intake.positions.latest_on("0")) and p.x_m == pytest.approx(x))


# --- taking a source out of the maps --------------------------------------------------------------------------------


def remove(scene, source: str, **span):
    request = RemoveFromMaps(stamp_ns=clock_ns(), source=source, **span)
    return scene.client.ask(contract.REMOVE_FROM_MAPS, request, fusion="fusion").message


def newest_removal(scene):
    """The newest removal, as fusion tells it now; None if it isn't there, or there is none."""
    got = scene.client.ask_all(contract.MAP_REMOVALS, timeout_s=1.0)
    return got[0].message.removals[-1] if got and got[0].message.removals else None


def all_answers(scene, target="bed"):
    """What fusion answers about its floor: layers, cloud with provenance in a fixed order, and objects."""
    told = {}
    for name in ("occupancy", "explored", "frontier", "value"):
        header, array = scene.layer(name, **({"target": target} if name == "value" else {}))
        told[name] = header.grid, header.revision, array.tobytes()
    (_, cloud), (header, lines) = scene.layer("cloud"), scene.layer("provenance")
    order = np.lexsort(cloud.T)
    told["cloud"] = cloud[order].tobytes(), lines[order].tobytes(), header.source_sets
    told["objects"] = scene.client.ask(contract.OBJECTS, floor="0", parameters={"history": "all"}).message.objects
    return told


def answers_of(joint: JointMap):
    """The same of a joint map."""
    text = unpack_embedding(pack_embedding(np.array([0.6, 0.8, 0, 0], np.float32)))
    revision, told = joint.floor_revision("0"), {}
    for name in ("occupancy", "explored", "frontier", "value"):
        grid, array = joint.layer("0", name, text)
        told[name] = grid, revision, array.tobytes()
    cloud, lines = joint.layer("0", "cloud")[1], joint.layer("0", "provenance")[1]
    order = np.lexsort(cloud.T)
    told["cloud"] = cloud[order].tobytes(), lines[order].tobytes(), joint.source_sets("0")
    told["objects"] = joint.objects("0")
    return told


class Undisturbed:
    """Maps that never got the camera, and those of a scene that did."""

    def __init__(self, scene) -> None:
        self.scene, self.worker, self.camera = scene, scene.worker(), scene.camera()
        self.joint = JointMap()

    def accept(self, header, payload) -> None:
        reply = self.worker.reply(header.source, header.view, header.seq)
        self.joint.accept(decode_frame(header, payload), perception_from_wire(reply, CAMERA))

    def robot_looks(self, yaw: float) -> None:
        seq = self.scene.robot.observe(yaw=yaw)
        until(lambda: self.scene.holds(seq), timeout_s=60)
        self.accept(*self.scene.robot.last)

    def camera_looks(self) -> None:
        until(lambda: self.camera.invoked, timeout_s=20)
        for view in (0, 1):
            self.camera.send(view)
        until(
            lambda: (r := self.scene.revision()) and r.cameras and r.cameras[0].views_processed == 2,
            timeout_s=20,
        )


def test_a_camera_is_taken_out_while_views_keep_coming(scene, tmp_path):
    """The old maps answer meanwhile, no observation is lost, and the camera is looked through anew when it looks again."""
    undisturbed = Undisturbed(scene)
    worker, camera = undisturbed.worker, undisturbed.camera
    scene.start(store=str(tmp_path / "fusion.sqlite"), snapshot_views=4)
    undisturbed.robot_looks(0.0)
    undisturbed.camera_looks()
    for k in range(1, 9):
        undisturbed.robot_looks(0.3 * k)
    camera.paused = True
    with pytest.raises(Refused, match=r"robot/r.*camera/c|camera/c.*robot/r") as refused:
        remove(scene, "camera/nobody")
    assert refused.value.name == "unknown_source"
    assert remove(scene, "camera/c").way == "replay"
    k = 9
    while newest_removal(scene).state == "running" or k < 12:
        undisturbed.robot_looks(0.3 * k)  # a mission goes on
        assert scene.layer("occupancy")[0].revision
        k += 1
    assert newest_removal(scene).state == "done"
    assert all_answers(scene) == answers_of(undisturbed.joint)
    asked = len([s for s in worker.seen if s[0] == "camera/c"])
    camera.paused = False
    camera.encoded.clear()
    for view in (0, 1):
        camera.send(view)
        until(lambda view=view: ("camera/c", view, 0) in worker.seen[asked:])
        until(lambda view=view: scene.revision().cameras[0].views_processed > view)
    assert any("camera/c" in members for members in scene.layer("provenance")[0].source_sets)


def test_a_camera_that_is_taken_out_and_still_looks_is_asked_for_its_views_again(scene, tmp_path):
    undisturbed = Undisturbed(scene)
    scene.start(store=str(tmp_path / "fusion.sqlite"), resend_after_s=60.0)
    undisturbed.robot_looks(0.0)
    undisturbed.camera_looks()
    undisturbed.camera.asked.clear()
    remove(scene, "camera/c")
    until(lambda: undisturbed.camera.asked == [[0, 1]])
    until(lambda: scene.revision().cameras[0].views_processed == 2)


def test_a_camera_that_leans_is_taken_out_by_itself_once_two_views_say_so(scene, tmp_path):
    undisturbed = Undisturbed(scene)
    camera = undisturbed.camera
    turn, _ = cv2.Rodrigues(np.radians([6.0, 0.0, 0.0]))
    wrong = [v.T_world_camera.copy() for v in camera.views]
    for T in wrong:
        T[:3, :3] = turn @ T[:3, :3]
    camera.views = [replace(v, T_world_camera=T) for v, T in zip(camera.views, wrong, strict=True)]
    scene.start(store=str(tmp_path / "fusion.sqlite"))
    undisturbed.robot_looks(0.0)
    undisturbed.camera_looks()
    until(lambda: (r := newest_removal(scene)) and r.state == "done", timeout_s=30)
    assert newest_removal(scene).source == "camera/c"
    assert "leans otherwise than stated" in newest_removal(scene).message
    assert "leans otherwise than stated" in scene.revision().cameras[0].quarantine
    undisturbed.robot_looks(0.3)
    assert all_answers(scene) == answers_of(undisturbed.joint)


def test_the_mission_of_a_robot_that_is_taken_out_goes_on(scene, tmp_path):
    """Its observations count as processed, though the maps don't hold them any more; what it sees next enters them."""
    undisturbed = Undisturbed(scene)
    undisturbed.camera.paused = True
    scene.start(store=str(tmp_path / "fusion.sqlite"))
    for k in range(3):
        undisturbed.robot_looks(0.3 * k)
    remove(scene, "robot/r")
    until(lambda: newest_removal(scene).state == "done")
    scene.robot.repeat()
    until(lambda: (r := ask_revision(scene)) and (r.revision, r.robots) == (0, {"r": 3}))
    assert not scene.layer("explored")[1].any(), "empty maps of its floor"
    undisturbed.joint = JointMap()
    undisturbed.robot_looks(1.0)
    assert all_answers(scene) == answers_of(undisturbed.joint)


def test_without_a_file_the_source_is_taken_out_by_provenance(scene):
    undisturbed = Undisturbed(scene)
    scene.start()
    undisturbed.robot_looks(0.0)
    undisturbed.camera_looks()
    undisturbed.camera.paused = True
    told = remove(scene, "camera/c")
    assert (told.way, told.state) == ("provenance", "done")
    assert "camera/c alone" in told.message
    assert not any(
        "camera/c" in m
        for m in np.array(scene.layer("provenance")[0].source_sets, object)[
            np.unique(scene.layer("provenance")[1][:, 0])
        ]
    )
    with pytest.raises(Refused, match="end of the time span"):
        remove(scene, "camera/c", since_ns=2, until_ns=1)
    with pytest.raises(Refused, match="expected camera/ID"):
        remove(scene, "c")


@pytest.mark.slow
def test_killed_while_a_camera_is_taken_out_it_is_out_afterwards(scene, process):
    """Killed again and again: during the replay, and while it starts."""
    rng = random.Random(3)
    undisturbed = Undisturbed(scene)
    fusion = process(snapshot_views=5)
    until(lambda: "fusion" in scene.client.alive("fusion"), timeout_s=60)
    undisturbed.robot_looks(0.0)
    undisturbed.camera_looks()
    for k in range(1, 22):
        undisturbed.robot_looks(0.3 * k)
    undisturbed.camera.paused = True
    assert remove(scene, "camera/c").state == "running"
    for delay_s in (rng.uniform(0.0, 0.15), 0.8, 1.5):
        time.sleep(delay_s)
        fusion.kill()
        fusion.start()
    until(lambda: ask_revision(scene), timeout_s=60)
    until(lambda: (r := newest_removal(scene)) and r.state == "done", timeout_s=20)
    scene.robot.repeat()
    undisturbed.robot_looks(0.1)
    assert all_answers(scene) == answers_of(undisturbed.joint)
