"""The planner over real Zenoh, with a robot and maps out of the flat world."""

from __future__ import annotations

import math
import threading
import time

import numpy as np
import pytest

from services.planner.config import PlannerSettings
from services.planner.service import PlannerService
from surveilnav.contract import (
    MAP_LAYER,
    MAP_REVISION,
    MISSION_CANCEL,
    MISSION_GOAL,
    MISSION_PLAN,
    MISSION_STATUS,
    OBJECTS,
    ROBOT_COMMAND,
    ROBOT_STATUS,
)  # fmt: skip
from surveilnav.geometry import Pose, base_pose
from surveilnav.messages import (
    CommandReply,
    LayerHeader,
    MissionCancel,
    MissionGoal,
    ObjectList,
    Revision,
    RobotStatus,
)  # fmt: skip
from surveilnav.runtime import Answer, Refused
from surveilnav.sensing.packing import pack_array

ROOM = """
####################
#                  #
#             CC   #
#   R         CC   #
#                  #
#                  #
####################
"""
QUICK = PlannerSettings(late_s=0.1, ask_timeout_s=0.3, maps_timeout_s=0.8, robot_timeout_s=0.8, wait_for_cameras_s=0.4)


class Fakes:
    """A robot and a fusion service that share one flat world."""

    def __init__(self, make_node, world, robot="r1"):
        self.world, self.id, self.lock = world, robot, threading.Lock()
        self.commands, self.pending, self.answers, self.slow_at, self.slow_s = [], 0, True, -1, 0.0
        self.robot_node, self.fusion_node = make_node("robot", robot), make_node("fusion", f"fusion-{robot}")
        self.robot_node.serve(ROBOT_COMMAND, self.command, robot=robot)
        self.robot_node.serve(ROBOT_STATUS, lambda _: Answer(self.status()), robot=robot)
        self.status_publisher = self.robot_node.publisher(ROBOT_STATUS, robot=robot)
        self.floor = f"floor-{robot}"
        self.revisions = self.fusion_node.publisher(MAP_REVISION, floor=self.floor)
        self.fusion_node.serve(MAP_REVISION, lambda _: Answer(self.revision()), floor=self.floor)
        self.fusion_node.serve(MAP_LAYER, self.layer, floor=self.floor)
        self.fusion_node.serve(OBJECTS, self.objects, floor=self.floor)
        self.tell()

    def tell(self):
        self.status_publisher.put(self.status())
        if self.answers:
            self.revisions.put(self.revision())

    def status(self):
        pose = Pose.from_matrix(base_pose((self.world.x, self.world.y, 0.0), self.world.yaw))
        seq = self.world.seq
        return RobotStatus(stamp_ns=1, robot=self.id, floor=self.floor, seq=seq, state="ready", T_world_base=pose)

    def revision(self):
        held = {self.id: self.world.seq} if self.answers else {}
        return Revision(
            stamp_ns=time.time_ns(), floor=self.floor, revision=self.world.seq, floor_z_m=0.0, robots=held, cameras=[],
            pending_views=self.pending,
        )  # fmt: skip

    def command(self, request):
        command = request.message
        with self.lock:
            if command.seq_expected != self.world.seq:
                return Answer(CommandReply(stamp_ns=1, accepted=False, seq=self.world.seq, error="seq"))
            self.commands.append(command.action)
            if command.action == "stop":
                self.world.seq += 1
            else:
                self.world.act(command.action)
            reply = Answer(CommandReply(stamp_ns=1, accepted=True, seq=self.world.seq))
            self.tell()
        time.sleep(self.slow_s)
        if len(self.commands) == self.slow_at:
            time.sleep(0.5)  # longer than the planner waits for an answer
        return reply

    def layer(self, request):
        with self.lock:
            maps = self.world.maps()
        layer = request.ids["layer"]
        array = getattr(maps, layer)
        assert (request.parameters.get("target") == "chair") == (layer == "value")
        header = LayerHeader(
            stamp_ns=1, floor=self.floor, layer=layer, revision=maps.revision, grid=maps.grid,
            dtype="float32" if layer == "value" else "uint8", shape=array.shape,
        )  # fmt: skip
        return Answer(header, pack_array(np.asarray(array)))

    def objects(self, request):
        with self.lock:
            objects = self.world.objects()
        return Answer(ObjectList(stamp_ns=1, floor=self.floor, revision=self.world.seq, objects=objects))


@pytest.fixture
def fakes(make_node, world, thing):
    make_node("perception", "p1")
    return lambda robot="r1", looks_like="chair": Fakes(
        make_node, world(ROOM, {"C": thing("chair", looks_like=looks_like)}, yaw_rad=math.pi), robot
    )


@pytest.fixture
def client(make_node):
    return make_node("test", "client", alive=False)


@pytest.fixture
def planner(make_node):
    def start(settings=QUICK):
        service = PlannerService(make_node("planner", "planner"), settings)
        time.sleep(0.1)  # robots' status and liveliness arrive
        return service

    return start


def submit(client, mission="m1", target="chair", **more):
    goal = MissionGoal(stamp_ns=1, mission=mission, target=target, **more)
    return client.ask(MISSION_GOAL, goal, mission=mission, timeout_s=3).message


def end_of(client, mission="m1", timeout_s=20.0):
    deadline_s = time.monotonic() + timeout_s
    while time.monotonic() < deadline_s:
        status = client.ask(MISSION_STATUS, mission=mission).message
        if status.state in ("done", "failed", "cancelled"):
            return status
        time.sleep(0.02)
    raise AssertionError(f"mission {mission} didn't end: {status}")


def test_finds_and_stops(fakes, planner, client):
    f = fakes()
    planner()
    ack = submit(client, target="Chair")
    assert (ack.accepted, ack.robot) == (True, "r1"), ack
    status = end_of(client)
    assert (status.state, status.found, status.error) == ("done", True, ""), status
    assert f.commands[-1] == "stop"
    assert f.commands.count("stop") == 1
    assert f.world.gap_m("C") <= 0.75
    assert status.step == len(f.commands)
    assert status.path_m == pytest.approx(f.world.path_m, abs=0.02)
    plan = client.ask(MISSION_PLAN, mission="m1").message
    assert plan.waypoint is not None
    assert plan.action == "stop"
    assert plan.waypoint.object_id == status.object_id
    assert [a.ids["mission"] for a in client.ask_all(MISSION_STATUS)] == ["m1"]


def test_several_robots_at_once_and_one_mission_each(fakes, planner, client):
    a, b = fakes("r1"), fakes("r2")
    planner()
    robots = {submit(client, m).robot for m in ("m1", "m2")}
    refused = submit(client, "m3")
    assert robots == {"r1", "r2"}
    assert (refused.accepted, refused.error) == (False, "no_free_robot")
    assert "m1" in refused.message
    assert "m2" in refused.message
    assert submit(client, "m4", robot="r1").error == "robot_busy"
    assert end_of(client, "m1").found
    assert end_of(client, "m2").found
    assert a.commands
    assert b.commands
    assert {a.ids["mission"] for a in client.ask_all(MISSION_STATUS)} == {"m1", "m2"}


@pytest.mark.parametrize(
    ("goal", "error", "text"),
    [
        ({"target": "unicorn"}, "bad_target", "couch"),
        ({"target": ""}, "bad_target", "couch"),
        ({"robot": "r9"}, "unknown_robot", "r1"),
        ({"max_steps": 0}, "bad_goal", "1 to"),
        ({"max_steps": 10**9}, "bad_goal", "1 to"),
    ],
)
def test_refuses_with_a_word_of_advice(fakes, planner, client, goal, error, text):
    fakes()
    planner()
    ack = submit(client, **goal)
    assert (ack.accepted, ack.error) == (False, error)
    assert text in ack.message
    assert client.ask_all(MISSION_STATUS) == []


def test_no_robot(planner, client):
    planner()
    ack = submit(client)
    assert (ack.accepted, ack.error) == (False, "no_free_robot")


def test_same_goal_twice_is_one_mission(fakes, planner, client):
    fakes()
    planner()
    assert submit(client).accepted
    assert submit(client).accepted
    assert submit(client, target="bed").error == "mission_exists"


def test_cancel_stops_the_robot(fakes, planner, client):
    f = fakes(looks_like="")
    f.slow_s = 0.03
    planner()
    submit(client)
    while len(f.commands) < 3:
        time.sleep(0.01)
    cancel = MissionCancel(stamp_ns=1, mission="m1", reason="changed my mind")
    ack = client.ask(MISSION_CANCEL, cancel, mission="m1", timeout_s=5).message
    assert (ack.accepted, ack.state) == (True, "cancelled"), ack
    assert f.commands[-1] == "stop"
    assert end_of(client).message == "changed my mind"
    again = client.ask(MISSION_CANCEL, cancel, mission="m1").message
    assert (again.accepted, again.state) == (False, "cancelled")
    unknown = client.ask(MISSION_CANCEL, MissionCancel(stamp_ns=1, mission="x"), mission="x").message
    assert unknown.error == "unknown_mission"
    assert submit(client, "m2").accepted  # the robot is free again


def test_holds_still_while_maps_are_late_then_goes_on(fakes, planner, client):
    f = fakes()
    f.answers = False
    planner(QUICK.model_copy(update={"maps_timeout_s": 10.0}))
    submit(client)
    time.sleep(0.4)
    status = client.ask(MISSION_STATUS, mission="m1").message
    assert (status.state, status.phase) == ("active", "waiting")
    assert "holding still" in status.message
    assert not f.commands
    f.answers = True
    f.tell()
    assert end_of(client).found


def test_late_maps_fail_by_name(fakes, planner, client):
    f = fakes()
    f.answers = False
    planner()
    submit(client)
    status = end_of(client)
    assert (status.state, status.error) == ("failed", "fusion_down")
    assert f.commands == ["stop"]


def test_waits_for_the_cameras_first_views(fakes, planner, client):
    f = fakes()
    f.pending = 3
    planner()
    submit(client)
    time.sleep(0.2)
    status = client.ask(MISSION_STATUS, mission="m1").message
    assert "cameras" in status.message
    assert not f.commands
    assert end_of(client).found  # after wait_for_cameras_s it starts without them


def test_lost_robot(fakes, planner, client):
    f = fakes()
    planner()

    def deaf():  # its liveliness token and an old status are all that is left of it
        raise Refused("busy", "deaf")

    f.status = deaf
    assert submit(client).accepted
    assert end_of(client).error == "robot_lost"


def test_a_lost_answer_is_not_a_second_step(fakes, planner, client):
    f = fakes()
    f.slow_at = 5
    planner()
    submit(client)
    status = end_of(client)
    assert status.found
    assert status.step == len(f.commands) == f.world.seq
