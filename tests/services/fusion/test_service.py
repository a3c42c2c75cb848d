"""The fusion service over real Zenoh, among robots, cameras and workers made of a few lines."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest

from services.fusion.config import FusionSettings
from services.fusion.service import FusionService
from surveilnav import contract
from surveilnav.geometry import Grid, Pinhole, Pose, base_pose
from surveilnav.messages import (
    Ack,
    CameraInfo,
    CameraViewInfo,
    FrameHeader,
    InferReply,
    Observation,
    RobotStatus,
    TextReply,
    WorkerLoad,
)
from surveilnav.runtime import Answer, Node, Refused, clock_ns
from surveilnav.sensing.packing import encode_rgbd, pack_embedding, perception_to_wire, unpack_array
from surveilnav.sensing.views import Detected, ViewPerception

CAMERA = Pinhole.from_hfov(160, 120, math.radians(79))
RANGE_M = (0.1, 10.0)


def until(condition: Callable[[], object], timeout_s: float = 8.0) -> object:
    """The first true value of a condition."""
    end_s = time.monotonic() + timeout_s
    while time.monotonic() < end_s:
        if found := condition():
            return found
        time.sleep(0.02)
    pytest.fail("waited in vain")


def header_of(view, kind=FrameHeader, **more):
    payload, image, depth = encode_rgbd(view.rgb, view.depth_m, depth_range_m=RANGE_M)
    header = kind(
        stamp_ns=clock_ns(), source=view.source, view=view.view, seq=view.seq, floor=view.floor, camera=view.camera,
        T_world_camera=Pose.from_matrix(view.T_world_camera), mounting_offset_m=view.mounting_offset_m,
        depth_range_m=RANGE_M, image=image, depth=depth, **more,
    )  # fmt: skip
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
        place = {"floor": floor, "camera": name}
        node.serve(contract.CAMERA_INFO, lambda _: Answer(self.info()), **place)
        node.serve(contract.CAMERA_REQUEST, self._on_request, **place)
        node.publisher(contract.CAMERA_INFO, **place).put(self.info())

    def info(self) -> CameraInfo:
        v = self.views[0]
        return CameraInfo(
            stamp_ns=clock_ns(), camera=self.name, floor=self.floor, position_m=tuple(v.T_world_camera[:3, 3].tolist()),
            mounting_offset_m=1.8, intrinsics=CAMERA,
            views=[CameraViewInfo(w.view, Pose.from_matrix(w.T_world_camera)) for w in self.views],
        )  # fmt: skip

    @property
    def invoked(self) -> bool:
        return any(p.matched for p in self.frames)

    def send(self, view: int) -> None:
        self.frames[view].put(*header_of(self.views[view]))

    def _on_request(self, request) -> Answer:
        self.asked.append(list(request.message.views))
        for view in request.message.views:
            self.send(view)
        return Answer(Ack(stamp_ns=clock_ns()))


class Worker:
    """Sees a chair in the middle of every picture."""

    def __init__(self, node: Node) -> None:
        self.node, self.seen, self.texts, self.refuse = node, [], [], ""
        self._load = node.publisher(contract.PERCEPTION_LOAD, worker="w")
        node.serve(contract.PERCEPTION_LOAD, lambda _: Answer(self._state()), worker="w")
        node.serve(contract.PERCEPTION_INFER, self._infer, worker="w")
        node.serve(contract.PERCEPTION_TEXT, self._text, worker="w")
        threading.Thread(target=self._say, daemon=True).start()

    def _say(self) -> None:
        while not self.node.stopping.wait(0.3):
            self._load.put(self._state())

    def _state(self) -> WorkerLoad:
        return WorkerLoad(stamp_ns=clock_ns(), worker="w", backend="fake", why="", queued=0, capacity=4, latency_ms=1.0)

    def _infer(self, request) -> Answer:
        m = request.message
        self.seen.append((m.source, m.view, m.seq))
        if self.refuse:
            raise Refused(self.refuse, "not now")
        look = np.eye(4, dtype=np.float32)
        chair = Detected("chair", 0.8, (60.0, 60.0, 100.0, 110.0), None, look[0])
        detections, image = perception_to_wire(ViewPerception("fake", (chair,), look[1]))
        return Answer(
            InferReply(
                stamp_ns=clock_ns(), worker="w", backend="fake", source=m.source, view=m.view, seq=m.seq,
                detections=detections, image_embedding=image,
            )
        )  # fmt: skip

    def _text(self, request) -> Answer:
        self.texts += request.message.texts
        embedding = pack_embedding(np.array([0.6, 0.8, 0, 0], np.float32))
        return Answer(TextReply(stamp_ns=clock_ns(), worker="w", backend="fake", embeddings=[embedding]))


class Scene:
    """A fusion service and its neighbours."""

    def __init__(self, make_node, world) -> None:
        self.make_node, self.world = make_node, world
        self.client = make_node("test", "client", alive=False)
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

    def layer(self, name, **parameters):
        got = self.client.ask(contract.MAP_LAYER, floor="0", layer=name, parameters=parameters)
        return got.message, unpack_array(got.payload, got.message.dtype, got.message.shape)


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
    until(lambda: any(c.camera == "here" and c.views_held for c in scene.revision().cameras))
    here.send(0)  # the same picture again
    until(lambda: here.asked)  # view 1 never came: fusion asks for it
    assert here.asked[0] == [1]
    revision = until(lambda: (r := scene.revision()) and r.pending_views == 0 and r)
    assert [(c.camera, c.views_held, c.views) for c in revision.cameras] == [("here", 2, 2)]
    assert not upstairs.invoked
    asked = [s for s in worker.seen if s[0].startswith("camera/")]
    assert sorted(asked) == [("camera/here", 0, 0), ("camera/here", 1, 0)]
    scene.robot.observe(floor="1", floor_z=2.8)  # the robot goes upstairs
    until(lambda: upstairs.invoked and not here.invoked)
    until(lambda: (r := scene.revision()) and not r.cameras and not r.robots)


def test_surveillance_can_be_switched_off(scene):
    scene.worker()
    camera = scene.camera()
    scene.start(surveillance=False)
    seq = scene.robot.observe()
    until(lambda: scene.holds(seq))
    assert not camera.invoked
    assert scene.revision().cameras == []


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
    until(lambda: any(c.views_held for c in scene.revision().cameras))
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
