"""The planner over real Zenoh, with a robot and maps out of the flat world."""

from __future__ import annotations

import math
import os
import random
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import msgspec
import numpy as np
import pytest

from surveilnav.bus import Answer, Refused, Unanswered
from surveilnav.contract import (
    CAMERA_SEARCH,
    CAMERA_SUMMARY,
    FLOOR_MAPS,
    MAP_REVISION,
    MISSION_CANCEL,
    MISSION_GOAL,
    MISSION_PAUSE,
    MISSION_PLAN,
    MISSION_STATUS,
    PERCEPTION_LOAD,
    PERCEPTION_TEXT,
    ROBOT_COMMAND,
    ROBOT_STATUS,
)
from surveilnav.geometry import Pose, base_pose
from surveilnav.messages import (
    FINISHED_STATES,
    CameraSearchReport,
    CameraSummary,
    CommandReply,
    FloorMapsHeader,
    LayerPart,
    MissionCancel,
    MissionGoal,
    MissionPause,
    ModelIds,
    Revision,
    RobotFrameProblem,
    RobotStatus,
    Stair,
    TextReply,
    WorkerLoad,
)
from surveilnav.sensing.packing import pack_array
from surveilnav.services.planner import targets
from surveilnav.services.planner.config import PlannerSettings
from surveilnav.services.planner.core import PlannerConfig
from surveilnav.services.planner.service import PlannerService
from surveilnav.services.planner.store import Store
from tests.waiting import patient, repeat_until, until, until_heard

ROOM = """
####################
#                  #
#             CC   #
#   R         CC   #
#                  #
#                  #
####################
"""
QUICK = PlannerSettings(late_s=0.1, ask_timeout_s=0.3, maps_timeout_s=0.8, robot_timeout_s=0.8)


class Fakes:
    """A robot and a fusion service that share flat worlds, one a floor."""

    def __init__(self, make_node, worlds, robot="r1", stairs=()):
        self.worlds, self.floor, self.stairs = worlds, next(iter(worlds)), list(stairs)
        self.id, self.lock = robot, threading.Lock()
        self.commands, self.stops_found, self.pending, self.answers, self.slow_at, self.slow_s = (
            [],
            [],
            0,
            True,
            -1,
            0.0,
        )
        self.refuses_stairs, self.seqs, self.deaf = 0, [], False
        self.state, self.battery, self.frames = "ready", None, []
        self.mission, self.last_action, self.climbed_m, self.path_before_m = "", None, 0.0, 0.0
        self.robot_node, self.fusion_node = make_node("robot", robot), make_node("fusion", f"fusion-{robot}")
        self.robot_node.serve(ROBOT_COMMAND, self.command, robot=robot)
        self.robot_node.serve(ROBOT_STATUS, self.answer_status, robot=robot)
        self.status_publisher = self.robot_node.publisher(ROBOT_STATUS, robot=robot)
        self.revisions = {floor: self.fusion_node.publisher(MAP_REVISION, floor=floor) for floor in worlds}
        for floor in worlds:
            self.fusion_node.serve(MAP_REVISION, lambda _, floor=floor: Answer(self.revision(floor)), floor=floor)
            self.fusion_node.serve(FLOOR_MAPS, self.floor_maps, floor=floor)
        self.tell()

    @property
    def world(self):
        return self.worlds[self.floor]

    def tell(self):
        self.status_publisher.put(self.status())
        if self.answers:
            for floor, publisher in self.revisions.items():
                publisher.put(self.revision(floor))

    def status(self):
        pose = Pose.from_matrix(base_pose((self.world.x, self.world.y, 0.0), self.world.yaw))
        return RobotStatus(
            stamp_ns=1,
            robot=self.id,
            floor=self.floor,
            seq=self.world.seq,
            state=self.state,
            T_world_base=pose,
            pitch_rad=self.world.pitch,
            stairs=self.stairs,
            mission=self.mission,
            collided=self.world.collided,
            last_action=self.last_action,
            path_m=self.path_m(),
            battery=self.battery,
        )

    def path_m(self):
        """Of this mission: on all floors, and over stairs."""
        return sum(world.path_m for world in self.worlds.values()) + self.climbed_m - self.path_before_m

    def answer_status(self, request):
        while self.deaf:
            time.sleep(0.01)
        return Answer(self.status())

    def revision(self, floor):
        held = {self.id: self.world.seq} if self.answers and floor == self.floor else {}
        return Revision(
            stamp_ns=time.time_ns(),
            floor=floor,
            revision=self.worlds[floor].seq,
            floor_z_m=0.0,
            robots=held,
            cameras=[],
            pending_views=self.pending,
            frames=self.frames,
        )

    def command(self, request):
        command = request.message
        with self.lock:
            if command.seq_expected != self.world.seq:
                return Answer(CommandReply(stamp_ns=1, accepted=False, seq=self.world.seq, error="seq"))
            if self.state == "halted" and command.action != "stop":
                raise Refused("halted", "the robot is halted (smoke): release it first")
            if command.action == "take_stairs" and (self.refuses_stairs or not self.near(command.to_floor)):
                self.refuses_stairs -= 1
                raise Refused("bad_command", "the stair is barred")
            if command.mission != self.mission:
                self.mission, self.path_before_m = command.mission, self.path_before_m + self.path_m()
            self.last_action = command.action
            self.commands.append(command.action)
            self.seqs.append(command.seq_expected)
            if command.action == "stop":
                self.stops_found.append(command.found)
                self.world.seq += 1
            elif command.action == "take_stairs":
                self.climb(command.to_floor)
            else:
                self.world.act(command.action)
            reply = Answer(CommandReply(stamp_ns=1, accepted=True, seq=self.world.seq))
            self.tell()
        time.sleep(self.slow_s)
        if len(self.commands) == self.slow_at:
            time.sleep(0.5)  # longer than the planner waits for an answer
        return reply

    def near(self, to_floor):
        """The stair to that floor, if the robot stands at it."""
        here = (self.world.x, self.world.y)
        stairs = [s for s in self.stairs if (s.floor, s.to_floor) == (self.floor, to_floor)]
        return next((s for s in stairs if math.dist(s.at_m[:2], here) <= 0.5), None)

    def climb(self, to_floor):
        stair, seq, yaw = self.near(to_floor), self.world.seq, self.world.yaw
        self.climbed_m += math.dist(stair.at_m[:2], (self.world.x, self.world.y)) + stair.length_m
        self.floor = to_floor
        (self.world.x, self.world.y), self.world.yaw, self.world.seq = stair.to_m[:2], yaw, seq + 1
        self.world.look()

    def floor_maps(self, request):
        assert request.parameters["target"] == "chair"
        floor = request.ids["floor"]
        world = self.worlds[floor]
        with self.lock:
            maps, objects = world.maps(), world.objects()
        arrays = {name: np.asarray(getattr(maps, name)) for name in ("occupancy", "explored", "frontier", "value")}
        packed = [pack_array(array) for array in arrays.values()]
        header = FloorMapsHeader(
            stamp_ns=1,
            floor=floor,
            target="chair",
            epoch="e",
            revision=maps.revision,
            since=-1,
            grid=maps.grid,
            layers=[
                LayerPart(name, str(array.dtype), array.shape, len(data))
                for (name, array), data in zip(arrays.items(), packed, strict=True)
            ],
            objects=objects,
            object_ids=[o.id for o in objects],
            robots=self.revision(floor).robots,
            pending_views=self.pending,
        )
        return Answer(header, b"".join(packed))


@pytest.fixture
def fakes(make_node, world, thing):
    make_node("perception", "p1")

    def fakes(robot="r1", looks_like="chair"):
        room = world(ROOM, {"C": thing("chair", looks_like=looks_like)}, yaw_rad=math.pi)
        return Fakes(make_node, {f"floor-{robot}": room}, robot)

    return fakes


@pytest.fixture
def client(make_node):
    return patient(make_node("test", "client", alive=False))


@pytest.fixture
def begin(client):
    """``begin(node, settings)``: a planner that others can reach."""

    def start(node, settings):
        service = PlannerService(node, settings)
        with pytest.raises(Refused):  # once it is there: it has no such mission
            until_heard(lambda: client.ask(MISSION_PLAN, mission="nobody-asked-for-it"))
        time.sleep(0.1)  # robots' status and liveliness arrive
        return service

    return start


@pytest.fixture
def planner(make_node, begin):
    return lambda settings=QUICK: begin(make_node("planner", "planner"), settings)


def offer(client, mission="m1", target="chair", **more):
    goal = MissionGoal(stamp_ns=1, mission=mission, target=target, **more)
    return client.ask(MISSION_GOAL, goal, mission=mission, timeout_s=3).message


def submit(client, mission="m1", **more):
    return until_heard(lambda: offer(client, mission, **more))


def end_of(client, mission="m1", timeout_s=20.0):
    def ended():
        status = client.ask(MISSION_STATUS, mission=mission).message
        return status if status.state in FINISHED_STATES else None

    return until(ended, lambda: client.ask(MISSION_STATUS, mission=mission).message, timeout_s)


def test_finds_and_stops(fakes, planner, client):
    f = fakes()
    planner()
    ack = submit(client, target="Chair")
    assert (ack.accepted, ack.robot) == (True, "r1"), ack
    status = end_of(client)
    assert (status.state, status.found, status.error) == ("done", True, ""), status
    assert f.commands[-1] == "stop"
    assert f.stops_found == [True]
    assert f.world.gap_m("C") <= PlannerConfig().stop_m
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
    ("workers", "accepted"),
    [
        ({}, True),
        ({"a": False}, False),
        ({"a": False, "b": True}, True),
        ({"a": None}, True),
        ({"a": None, "b": False}, False),
    ],
)
def test_a_target_is_what_some_worker_understands(fakes, planner, make_node, client, workers, accepted):
    """Workers by name: whether they know the word; None: they don't answer so."""
    fakes()
    for name, knows in workers.items():

        def answer(request, knows=knows):
            assert request.message.texts == ["seems like there is a samovar"]
            if knows is None:
                raise Refused("busy", "later")
            if not knows:
                raise Refused("bad_target", "nearest to it: vase")
            return Answer(TextReply(stamp_ns=1, worker="w", backend="b", embeddings=[b""]))

        load = WorkerLoad(
            stamp_ns=1,
            worker=name,
            backend="b",
            why="",
            queued=0,
            capacity=1,
            latency_ms=1.0,
            models=ModelIds(detector=name),
        )
        worker = make_node("perception", name)
        worker.serve(PERCEPTION_TEXT, answer, worker=name)
        worker.serve(PERCEPTION_LOAD, lambda _, load=load: Answer(load), worker=name)
        until_heard(lambda name=name: client.ask(PERCEPTION_LOAD, worker=name))
    planner()
    ack = submit(client, "m1", target="Samovar")
    assert ack.accepted == accepted
    assert accepted or (ack.error, ack.message) == ("bad_target", "nearest to it: vase")


@pytest.mark.parametrize(
    ("asked", "words", "target"),
    [
        ("Fernseher", {"a": (False, ["tv"])}, "tv"),
        ("Fernseher", {"a": (True, [""]), "b": (False, ["tv"])}, "tv"),
        ("Fernseher", {"a": (True, [""])}, "fernseher"),
        ("Fernseher", {"a": (False, [])}, "fernseher"),
        ("Sofa", {"a": (False, ["couch"])}, "couch"),
        ("Fernseher", {"a": (False, ["t\x1bv"])}, "fernseher"),
    ],
    ids=["closed", "closed beside open", "open", "says nothing", "known spelling", "says no word"],
)
def test_a_target_has_the_name_that_perception_has_for_it(
    fakes, planner, make_node, client, monkeypatch, asked, words, target
):
    """Workers by name: whether they have an open vocabulary, and what they say of the word."""
    fakes()
    for name, (is_open, said) in words.items():
        reply = TextReply(stamp_ns=1, worker=name, backend="b", embeddings=[b""], words=said)
        load = WorkerLoad(
            stamp_ns=1,
            worker=name,
            backend="b",
            why="",
            queued=0,
            capacity=1,
            latency_ms=1.0,
            models=ModelIds(detector=name),
            open_vocabulary=is_open,
        )
        worker = make_node("perception", name)
        worker.serve(PERCEPTION_TEXT, lambda _, reply=reply: Answer(reply), worker=name)
        worker.serve(PERCEPTION_LOAD, lambda _, load=load: Answer(load), worker=name)
        until_heard(lambda name=name: client.ask(PERCEPTION_LOAD, worker=name))
    planner()
    ack = submit(client, "m1", target=asked)
    (status,) = (answer.message for answer in client.ask_all(MISSION_STATUS))
    assert (ack.target, status.target) == (target, target)
    assert status.asked == ("Fernseher" if target == "tv" else "")
    assert submit(client, "m1", target=asked).accepted, "the same goal sent again"
    monkeypatch.setattr(targets, "_one_of_each_model", lambda node: [])
    assert submit(client, "m1", target=asked).accepted, "and again, when no worker answers"
    assert not submit(client, "m1", target="bed").accepted


def test_a_worker_that_warms_up_is_asked_again(fakes, planner, make_node, client):
    fakes()
    asked = []

    def answer(request):
        asked.append(request)
        if len(asked) < 3:
            raise Refused("not_ready", "it warms up")
        return Answer(TextReply(stamp_ns=1, worker="a", backend="b", embeddings=[b""], words=["tv"]))

    load = WorkerLoad(stamp_ns=1, worker="a", backend="b", why="", queued=0, capacity=1, latency_ms=1.0)
    worker = make_node("perception", "a")
    worker.serve(PERCEPTION_TEXT, answer, worker="a")
    worker.serve(PERCEPTION_LOAD, lambda _: Answer(load), worker="a")
    until_heard(lambda: client.ask(PERCEPTION_LOAD, worker="a"))
    planner()
    assert submit(client, "m1", target="Fernseher").target == "tv"
    assert len(asked) == 3


@pytest.mark.parametrize(
    ("goal", "error", "text"),
    [
        ({"target": "x" * 500}, "bad_target", "up to 100 characters"),
        ({"target": ""}, "bad_target", "names a thing"),
        ({"target": "bed\x1b[2J"}, "bad_target", "can be seen"),
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
    until(lambda: len(f.commands) >= 3)
    cancel = MissionCancel(stamp_ns=1, mission="m1", reason="changed my mind")
    ack = client.ask(MISSION_CANCEL, cancel, mission="m1", timeout_s=5).message
    assert (ack.accepted, ack.state) == (True, "cancelled"), ack
    assert f.stops_found == [False]
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


def test_a_robot_that_begins_anew_while_its_view_is_awaited_is_asked_which_it_has_now(fakes, planner, client):
    f = fakes()
    f.answers = False
    f.world.seq = 4
    planner(QUICK.model_copy(update={"maps_timeout_s": 20.0}))
    submit(client)
    until_heard(lambda: "observation 4" in client.ask(MISSION_STATUS, mission="m1").message.message)
    f.world.seq, f.answers = 0, True  # it lost its store before it published view 4: now nobody ever will
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
    assert f.stops_found == [False]


def test_nothing_waits_for_cameras(fakes, planner, client):
    f = fakes()
    f.pending = 3
    planner()
    submit(client)
    assert end_of(client).found
    assert f.pending == 3


FIRST_LOOK = QUICK.model_copy(update={"first_look_s": 5.0})


@pytest.mark.parametrize("refusal", ["", "no_camera"])
def test_the_cameras_look_before_the_robot_moves(fakes, planner, client, refusal):
    f, asked = fakes(), []

    def search(request):
        asked.append((request.message.target, request.message.floor, request.message.max_s, len(f.commands)))
        if refusal:
            raise Refused(refusal, "no camera is there")
        time.sleep(0.4)
        asked.append(len(f.commands))
        return Answer(CameraSearchReport(stamp_ns=1, target="chair", cameras=[], lacking={}, complete=True))

    f.fusion_node.serve(CAMERA_SEARCH, search, fusion="fusion-r1")
    planner(FIRST_LOOK)
    submit(client)
    assert end_of(client).found
    assert asked == [("chair", "floor-r1", 5.0, 0)] + ([] if refusal else [0]), "once, and nothing moves meanwhile"


def test_without_the_setting_the_robot_drives_off_at_once(fakes, planner, client):
    f, asked = fakes(), []
    f.fusion_node.serve(CAMERA_SEARCH, lambda request: asked.append(request), fusion="fusion-r1")
    planner()
    submit(client)
    assert end_of(client).found
    assert not asked


def test_a_mission_is_cancelled_while_the_cameras_look(fakes, planner, client):
    f, begun, ends = fakes(), threading.Event(), threading.Event()

    def search(request):
        begun.set()
        ends.wait(20)
        raise Refused("no_camera", "too late")

    f.fusion_node.serve(CAMERA_SEARCH, search, fusion="fusion-r1")
    planner(FIRST_LOOK)
    submit(client)
    assert begun.wait(10)
    try:
        client.ask(MISSION_CANCEL, MissionCancel(stamp_ns=1, mission="m1"), mission="m1", timeout_s=5)
        assert end_of(client, timeout_s=3.0).state == "cancelled"
    finally:
        ends.set()
    assert set(f.commands) <= {"stop"}


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


# --- pausing, halting, waiting for a robot -----------------------------------------------------------------------------


def pause(client, mission="m1", *, paused=True, reason="lunch"):
    message = MissionPause(stamp_ns=1, mission=mission, paused=paused, reason=reason)
    return client.ask(MISSION_PAUSE, message, mission=mission, timeout_s=5).message


def status_of(client, mission="m1"):
    return client.ask(MISSION_STATUS, mission=mission).message


def under_way(client, f, actions=3):
    """A mission that takes its time, after so many actions."""
    f.slow_s = 0.03
    submit(client)
    until(lambda: len(f.commands) >= actions)


def stands_still(f, seconds=0.4):
    commands = len(f.commands)
    time.sleep(seconds)
    return len(f.commands) == commands


def test_a_paused_mission_stands_still_and_then_finds(fakes, planner, client):
    f = fakes()
    planner()
    under_way(client, f)
    ack = pause(client)
    assert (ack.accepted, ack.state) == (True, "paused")
    assert (status_of(client).state, status_of(client).message) == ("paused", "lunch")
    assert stands_still(f)
    assert pause(client, reason="still lunch").accepted  # again is as good as once
    ack = pause(client, paused=False)
    assert (ack.accepted, ack.state) == (True, "active")
    status = end_of(client)
    assert (status.state, status.found) == ("done", True)
    assert f.seqs == sorted(set(f.seqs)), "no action ran twice"
    assert status.step == len(f.commands)
    for paused in (True, False):
        late = pause(client, paused=paused)
        assert (late.accepted, late.state) == (False, "done")
    assert pause(client, "nobody").error == "unknown_mission"


def test_a_pause_outlasts_maps_that_are_late(fakes, planner, client):
    f = fakes()
    f.answers = False
    planner()  # waits 0.8 s for maps
    submit(client)
    assert pause(client).state == "paused"
    time.sleep(1.0)
    assert status_of(client).state == "paused"
    f.answers = True
    f.tell()
    assert pause(client, paused=False).accepted
    assert end_of(client).found


def test_a_paused_mission_is_cancelled(fakes, planner, client):
    f = fakes()
    planner()
    under_way(client, f)
    pause(client)
    cancel = MissionCancel(stamp_ns=1, mission="m1", reason="enough")
    assert client.ask(MISSION_CANCEL, cancel, mission="m1", timeout_s=5).message.state == "cancelled"
    assert f.commands[-1] == "stop"


def test_a_halted_robots_mission_pauses_until_a_person_has_it_go_on(fakes, planner, client):
    f = fakes()
    planner()
    under_way(client, f)
    f.state = "halted"
    f.tell()
    until(lambda: status_of(client).state == "paused")
    assert "release it, then resume" in status_of(client).message
    assert pause(client, paused=False).error == "robot_halted"
    assert submit(client, "m2", robot="r1").error == "robot_busy"
    f.state = "ready"
    f.tell()
    assert stands_still(f), "a robot that was released doesn't set out by itself"
    until(lambda: pause(client, paused=False).accepted)
    status = end_of(client)
    assert (status.found, status.step) == (True, len(f.commands)), "what was refused is no step"


def test_a_halted_robot_gets_no_mission(fakes, planner, client):
    f = fakes()
    f.state = "halted"
    f.tell()
    planner()
    refused = submit(client, robot="r1")
    assert (refused.error, "release" in refused.message) == ("robot_halted", True)
    refused = submit(client, "m2")
    assert (refused.error, "r1 halted" in refused.message) == ("no_free_robot", True)


@pytest.mark.parametrize(
    ("battery", "accepted"), [(0.14, False), (0.15, True), (None, True), (math.nan, True), (-3.0, True)]
)
def test_a_robot_with_a_low_battery_gets_no_new_mission_and_ends_the_one_that_it_is_on(
    fakes, planner, client, battery, accepted
):
    f = fakes()
    f.battery = 1.0
    f.slow_s = 0.02
    planner()
    assert submit(client).accepted
    until(lambda: len(f.commands) >= 2)
    f.battery = battery
    f.tell()
    assert end_of(client).found
    until(lambda: offer(client, "m2").error in ("", "robot_battery", "no_free_robot"))
    named, any_one = offer(client, "m3", robot="r1"), offer(client, "m4")
    if accepted:
        assert named.error in ("", "robot_busy")
        return
    assert named.error == "robot_battery"
    assert named.message == "robot 'r1' has to charge first: its battery is at 14%, and 15% are needed"
    assert (any_one.error, "at 14%" in any_one.message) == ("no_free_robot", True)


def test_goals_wait_for_a_robot_in_their_order(fakes, planner, client):
    f = fakes()
    service = planner(QUICK.model_copy(update={"max_queued": 2}))
    under_way(client, f)
    pause(client)  # it keeps its robot for as long as it takes
    for mission in ("m2", "m3"):
        ack = submit(client, mission, queue=True)
        assert (ack.accepted, ack.state, ack.robot) == (True, "queued", "")
        assert status_of(client, mission).message == "waits: no robot is free (r1 on m1)"
    assert submit(client, "m4", queue=True).error == "queue_full"
    assert submit(client, "m5", queue=True, robot="r9").error == "unknown_robot"
    assert pause(client, "m2").error == "not_begun"
    cancel = MissionCancel(stamp_ns=1, mission="m2", reason="enough")
    assert client.ask(MISSION_CANCEL, cancel, mission="m2", timeout_s=5).message.state == "cancelled"
    assert submit(client, "m4", queue=True).accepted
    service.step()
    assert status_of(client, "m3").state == "queued"
    pause(client, paused=False)

    def ended():
        service.step()
        first, second = status_of(client, "m3"), status_of(client, "m4")
        assert first.state in FINISHED_STATES or not second.robot, "the second didn't wait for the first"
        return second.state in FINISHED_STATES

    until(ended, lambda: status_of(client, "m4"), timeout_s=30)
    for mission in ("m3", "m4"):
        assert (status_of(client, mission).state, status_of(client, mission).robot) == ("done", "r1")
    assert status_of(client, "m2").state == "cancelled"


def test_paused_and_waiting_missions_outlive_the_planner(fakes, make_node, begin, client, tmp_path):
    f = fakes()
    settings = QUICK.model_copy(update={"store": str(tmp_path / "missions.db")})
    first = make_node("planner", "first")
    begin(first, settings)
    under_way(client, f)
    pause(client)
    assert submit(client, "m2", queue=True, robot="r1").accepted
    first.__exit__(None, None, None)
    service = begin(make_node("planner", "second"), settings)
    until(lambda: status_of(client).state == "paused")
    service.step()
    assert stands_still(f)
    assert pause(client, paused=False).accepted
    assert end_of(client).found
    repeat_until(service.step, lambda: status_of(client, "m2").state == "done", timeout_s=20)


def test_a_pause_for_the_robots_frame_outlives_the_planner_and_comes_once(fakes, make_node, begin, client, tmp_path):
    f = fakes()
    settings = QUICK.model_copy(update={"store": str(tmp_path / "missions.db")})
    first = make_node("planner", "first")
    begin(first, settings)
    under_way(client, f)
    f.frames = [RobotFrameProblem("r1", "robot r1 isn't where it says", 0.5, 0.0, 0.0)]
    until(lambda: status_of(client).state == "paused")
    first.__exit__(None, None, None)
    second = make_node("planner", "second")
    begin(second, settings)
    until(lambda: status_of(client).state == "paused")
    assert status_of(client).message == "robot r1 isn't where it says"
    assert stands_still(f)
    commands = len(f.commands)
    assert pause(client, paused=False).accepted
    until(lambda: len(f.commands) > commands)
    second.__exit__(None, None, None)
    begin(make_node("planner", "third"), settings)
    assert end_of(client).found, "a person has said that it may go on"


# --- several floors ---------------------------------------------------------------------------------------------------

DOWNSTAIRS = """
####################
#                  #
#   R              #
#                  #
#                  #
####################
"""
UPSTAIRS = """
####################
#                  #
#             CC   #
#             CC   #
#   R              #
####################
"""
FOOT, HEAD, LENGTH_M = (3.6, 0.6, 0.0), (0.9, 0.4, 3.0), 4.0
STAIRS = [
    Stair(floor="0", to_floor="1", at_m=FOOT, to_m=HEAD, length_m=LENGTH_M),
    Stair(floor="1", to_floor="0", at_m=HEAD, to_m=FOOT, length_m=LENGTH_M),
]


@pytest.fixture
def two_floors(make_node, world, thing):
    make_node("perception", "p1")

    def two_floors(stairs=STAIRS):
        up = world(UPSTAIRS, {"C": thing("chair", looks_like="chair")})
        return Fakes(make_node, {"0": world(DOWNSTAIRS), "1": up}, stairs=stairs)

    return two_floors


@pytest.fixture
def cameras(make_node):
    """Puts summaries as cameras do: ``cameras(floor, camera, labels)``, or with other facts than its key has."""
    node = make_node("test", "cameras", alive=False)
    publishers = {}

    def put(floor, camera, labels, said=None):
        place = floor, camera
        if place not in publishers:
            publishers[place] = node.publisher(CAMERA_SUMMARY, floor=floor, camera=camera)
        facts = {"stamp_ns": 1, "camera": camera, "floor": floor, "labels": labels} | (said or {})
        publishers[place].put(CameraSummary(**facts))

    return put


def rejected(planner, stream, n=1):
    """Waits until the planner has counted so many dropped messages."""
    until(lambda: planner._node.traffic.rejected().get(stream, 0) >= n, planner._node.traffic.rejected)
    return planner._node.traffic.rejected()[stream]


def test_over_the_stairs_to_where_the_cameras_saw_it(two_floors, planner, client, cameras):
    f = two_floors()
    planner()
    cameras("0", "c0-1", {"bed": 0.9})
    cameras("1", "c1-1", {"chair": 0.8, "tv": 0.3})
    time.sleep(0.1)
    submit(client)
    status = end_of(client)
    assert (status.state, status.found, status.floor) == ("done", True, "1"), status
    assert f.commands.count("take_stairs") == 1
    sizes = [
        len(msgspec.msgpack.encode(m))
        for m in (
            CameraSummary(stamp_ns=1, camera="c0-1", floor="0", labels={"bed": 0.9}),
            CameraSummary(stamp_ns=1, camera="c1-1", floor="1", labels={"chair": 0.8, "tv": 0.3}),
        )
    ]
    keys = len(client.key(CAMERA_SUMMARY, floor="0", camera="c0-1")) * 2
    assert status.floor_choice_bytes == sum(sizes) + keys
    walked_m = f.worlds["0"].path_m + f.worlds["1"].path_m
    assert walked_m + LENGTH_M <= status.path_m + 0.05 <= walked_m + LENGTH_M + 0.6


def test_a_refused_stair_does_not_end_the_mission(two_floors, planner, client, cameras):
    f = two_floors()
    f.refuses_stairs = 1
    planner()
    cameras("1", "c1-1", {"chair": 0.8})
    time.sleep(0.1)
    submit(client)
    status = end_of(client)
    assert (status.state, status.found, status.floor) == ("done", True, "1"), status
    assert f.refuses_stairs == 0


def test_a_stair_refused_for_ever_ends_in_a_named_failure(two_floors, planner, client, cameras):
    f = two_floors()
    f.refuses_stairs = 10**9
    planner()
    cameras("1", "c1-1", {"chair": 0.8})
    time.sleep(0.1)
    submit(client)
    status = end_of(client, timeout_s=60.0)
    assert status.state == "failed"
    assert status.error in ("not_found", "unreachable", "stuck"), status
    assert 10**9 - f.refuses_stairs <= 10


def test_stairs_that_cannot_be_are_dropped(two_floors, planner, client):
    mad = [
        msgspec.structs.replace(STAIRS[0], length_m=math.nan),
        msgspec.structs.replace(STAIRS[0], at_m=(0.0, math.inf, 0.0)),
        msgspec.structs.replace(STAIRS[0], to_floor="0"),
        msgspec.structs.replace(STAIRS[0], length_m=-1.0),
    ]
    f = two_floors(stairs=mad)
    service = planner()
    submit(client)
    status = end_of(client, timeout_s=60.0)
    assert (status.state, status.error) == ("failed", "not_found"), status
    assert "take_stairs" not in f.commands
    assert rejected(service, "stairs") > 1


@pytest.mark.parametrize(
    ("labels", "says"),
    [
        ({"chair": math.nan}, {}),
        ({"chair": 1.01}, {}),
        ({"chair": -0.1}, {}),
        ({"chair": 0.9, "x" * 65: 0.5}, {}),
        ({"chair": 0.9, "": 0.5}, {}),
        ({f"label {k}": 0.5 for k in range(60)} | {"chair": 0.9}, {}),
        ({"chair": 0.9}, {"floor": "0"}),
        ({"chair": 0.9}, {"camera": "c1-2"}),
    ],
)
def test_hostile_summaries_are_dropped_and_counted(planner, cameras, labels, says):
    service = planner()
    summaries = service._missions._context.summaries
    cameras("1", "c1-1", labels, said=says)
    cameras("1", "c1-9", {"chair": 0.25})
    until(lambda: summaries.by_floor() == {"1": {"chair": 0.25}}, summaries.by_floor)
    assert rejected(service, "camera_summary") == 1
    summaries.by_floor()
    assert rejected(service, "camera_summary") == 1, "a message is counted once"
    cameras("1", "c1-1", {"chair": 0.75})  # it comes to its senses
    until(lambda: summaries.by_floor() == {"1": {"chair": 0.75}}, summaries.by_floor)


def test_a_floor_is_what_its_cameras_last_said(planner, cameras, monkeypatch):
    summaries = planner()._missions._context.summaries
    cameras("0", "c0-1", {"tv": 0.5})
    cameras("0", "c0-2", {"tv": 0.7, "bed": 0.2})
    cameras("1", "c1-1", {})
    time.sleep(0.2)
    assert summaries.by_floor() == {"0": {"tv": 0.7, "bed": 0.2}, "1": {}}
    cameras("0", "c0-2", {"bed": 0.1})
    time.sleep(0.2)
    assert summaries.by_floor() == {"0": {"tv": 0.5, "bed": 0.1}, "1": {}}
    assert set(summaries.received_bytes()) == {"0", "1"}
    monkeypatch.setattr("surveilnav.services.planner.summaries._MAX_AGE_S", 0.0)
    assert summaries.by_floor() == {}, "what is stale is no evidence"


@pytest.mark.parametrize("nonsense", ["pitch", "path_m"])
def test_a_robot_that_talks_nonsense_is_silent(fakes, planner, client, nonsense):
    f = fakes()
    service = planner()
    setattr(f.world, nonsense, math.nan)
    submit(client)
    status = end_of(client)
    assert (status.state, status.error) == ("failed", "robot_lost")
    assert rejected(service, "robot_status") >= 1


# --- the store --------------------------------------------------------------------------------------------------------


@pytest.fixture
def process(bus, tmp_path):
    """``process()``: the planner as a process of its own with a store; a context, left by SIGKILL."""

    @contextmanager
    def running(**more):
        variables = {
            "SURVEILNAV_BUS__ROUTER": bus.router,
            "SURVEILNAV_BUS__BUILDING": bus.building,
            "SURVEILNAV_PLANNER__STORE": str(tmp_path / "planner.sqlite"),
            "SURVEILNAV_PLANNER__ROBOT_TIMEOUT_S": "5",
            "SURVEILNAV_PLANNER__MAPS_TIMEOUT_S": "5",
            **more,
        }
        with (tmp_path / "planner.log").open("ab") as log:
            command = [sys.executable, "-m", "surveilnav.services.planner"]
            child = subprocess.Popen(command, env=os.environ | variables, stdout=log, stderr=log)
        try:
            yield child
        finally:
            child.kill()
            child.wait()

    return running


def accepted(client, mission="m1", timeout_s=20.0, **more):
    """Submits until the planner has come up and met the robot."""

    def taken():
        try:
            ack = offer(client, mission, **more)
        except Unanswered:
            return None
        assert ack.accepted or ack.error == "no_free_robot", ack
        return ack if ack.accepted else None

    return until(taken, timeout_s=timeout_s)


def seen(client, mission="m1", timeout_s=20.0):

    def told():
        try:
            return client.ask(MISSION_STATUS, mission=mission, timeout_s=1).message
        except (Unanswered, Refused):
            return None

    return until(told, timeout_s=timeout_s)


@pytest.mark.parametrize("seed", [1, 2])
def test_killed_again_and_again_a_mission_ends_as_if_nothing_had_been(
    two_floors, planner, process, client, cameras, seed
):
    """The same actions in the same order as without a kill: none lost, none carried out twice."""
    untouched = two_floors()
    service = planner()
    cameras("1", "c1-1", {"chair": 0.8})
    time.sleep(0.1)
    submit(client, "calm", target="chair")
    assert end_of(client, "calm", 60.0).found
    service._node.__exit__(None, None, None)
    for node in (untouched.robot_node, untouched.fusion_node):
        node.__exit__(None, None, None)

    f, rng, kills, telling = two_floors(), random.Random(seed), 0, threading.Event()
    f.slow_s = 0.15

    def tell():
        while not telling.wait(0.3):
            cameras("1", "c1-1", {"chair": 0.8})

    threading.Thread(target=tell, daemon=True).start()
    try:
        while not f.commands or f.commands[-1] != "stop":
            with process() as child:
                if not kills:
                    accepted(client, max_steps=400)
                else:
                    seen(client)
                until_s = time.monotonic() + rng.uniform(0.0, 2.5)
                while time.monotonic() < until_s and f.commands[-1:] != ["stop"]:
                    time.sleep(0.005)
                child.kill()
                kills += 1
        with process():
            status = until(lambda: (s := seen(client)).state in FINISHED_STATES and s, lambda: seen(client))
    finally:
        telling.set()
    assert kills >= 3
    assert (status.state, status.found, status.floor) == ("done", True, "1"), status
    assert f.seqs == list(range(len(f.seqs)))
    assert f.commands == untouched.commands
    assert status.path_m == pytest.approx(f.worlds["0"].path_m + f.worlds["1"].path_m + LENGTH_M, abs=0.6)


def test_an_accepted_goal_exists_after_kill_9(fakes, process, client):
    f = fakes(looks_like="")
    f.slow_s = 0.1  # so that it still searches when the last question comes, however busy the machine is
    for k in range(3):
        with process() as child:
            accepted(client, f"m{k}", robot="r1") if k == 0 else seen(client, "m0")
            child.kill()  # at once
    with process():
        assert seen(client, "m0").target == "chair"
        assert submit(client, "m0").accepted, "the goal sent again is the same mission"
        assert submit(client, "other").error == "no_free_robot", "its robot is still its own"


def test_a_cancel_that_came_before_a_kill_is_carried_out_after_it(fakes, process, client):
    f = fakes(looks_like="")
    f.slow_s = 0.1
    with process():
        accepted(client)
        until(lambda: len(f.commands) >= 3)
        f.deaf = True  # so that the planner doesn't come to stop the robot before it is killed
        cancel = MissionCancel(stamp_ns=1, mission="m1", reason="enough")
        with pytest.raises(Unanswered):
            client.ask(MISSION_CANCEL, cancel, mission="m1", timeout_s=1)
    f.deaf = False
    assert "stop" not in f.commands
    with process():
        status = until(lambda: (s := seen(client)).state == "cancelled" and s, lambda: seen(client), timeout_s=10.0)
    assert status.message == "enough"
    assert f.commands.count("stop") == 1


def test_a_mission_whose_robot_is_gone_fails_by_name_after_a_restart(fakes, process, client):
    f = fakes(looks_like="")
    f.slow_s = 0.1
    with process():
        accepted(client)
        until(lambda: len(f.commands) >= 3)
    f.robot_node.__exit__(None, None, None)
    began_s = time.monotonic()
    with process(SURVEILNAV_PLANNER__ROBOT_TIMEOUT_S="1.5"):
        status = until(lambda: (s := seen(client)).state == "failed" and s, lambda: seen(client), timeout_s=15.0)
    assert status.error == "robot_lost", status
    assert time.monotonic() - began_s > 1.5


def test_finished_missions_are_listed_after_a_restart_the_oldest_forgotten(fakes, make_node, begin, client, tmp_path):
    settings = QUICK.model_copy(update={"store": str(tmp_path / "planner.sqlite"), "finished_missions_kept": 2})
    fakes()
    node = make_node("planner", "planner")
    begin(node, settings)
    ends = {}
    for id in ("m1", "m2", "m3", "m4"):
        submit(client, id)
        ends[id] = end_of(client, id)
    node.__exit__(None, None, None)
    assert client.ask_all(MISSION_STATUS) == []
    begin(make_node("planner", "planner"), settings)
    told = {a.ids["mission"]: a.message for a in client.ask_all(MISSION_STATUS)}
    assert told == {id: ends[id] for id in ("m3", "m4")}
    assert client.ask(MISSION_PLAN, mission="m4").message.action == "stop"
    assert submit(client, "m5").accepted, "the robot is free"


def test_what_cannot_be_kept_is_not_accepted_but_what_runs_goes_on(fakes, planner, client, tmp_path):
    f = fakes()
    f.slow_s = 0.03
    folder = tmp_path / "state"
    service = planner(QUICK.model_copy(update={"store": str(folder / "planner.sqlite")}))
    assert submit(client, "m1").accepted
    until(lambda: len(f.commands) >= 3)
    service._missions._store.close()
    folder.rename(tmp_path / "elsewhere")
    folder.write_text("in the way")
    assert end_of(client, "m1").found
    refused = submit(client, "m2")
    assert (refused.accepted, refused.error) == (False, "store_failed")
    assert "SURVEILNAV_PLANNER__STORE" in refused.message
    assert [a.ids["mission"] for a in client.ask_all(MISSION_STATUS)] == ["m1"]
    folder.unlink()  # mended
    service._saved_s = 0.0
    service.step()
    (kept,) = service._missions._store.load()
    assert kept.status.state == "done", "an ended mission must not begin again after a restart"
    assert submit(client, "m2").accepted


def test_nothing_is_accepted_before_the_store_was_read(fakes, planner, client, tmp_path):
    fakes()
    folder = tmp_path / "state"
    folder.write_text("in the way")
    service = planner(QUICK.model_copy(update={"store": str(folder / "planner.sqlite")}))
    folder.unlink()  # mended, but nobody knows yet which robots have missions
    assert submit(client, "m1").error == "store_failed"
    service._saved_s = 0.0
    service.step()
    assert submit(client, "m1").accepted


def test_of_two_open_missions_of_a_robot_the_later_goes_on(fakes, make_node, begin, client, tmp_path):
    settings = QUICK.model_copy(update={"store": str(tmp_path / "planner.sqlite")})
    f = fakes()
    f.slow_s = 0.05
    node = make_node("planner", "planner")
    begin(node, settings)
    submit(client, "m1")
    until(lambda: len(f.commands) >= 3)
    node.__exit__(None, None, None)
    store = Store(settings.store, client)
    (mission,) = store.load()
    later = msgspec.structs.replace(mission, status=msgspec.structs.replace(mission.status, mission="m2"))
    store.save(later)
    store.close()
    begin(make_node("planner", "planner"), settings)
    old = end_of(client, "m1")
    assert (old.state, old.error) == ("failed", "superseded")
    assert "m2" in old.message
    assert end_of(client, "m2").found
    assert f.seqs == list(range(len(f.seqs)))


def test_a_mission_that_was_lost_with_the_store_ends_by_name(fakes, make_node, begin, client, tmp_path):
    settings = QUICK.model_copy(update={"store": str(tmp_path / "planner.sqlite")})
    f = fakes()
    f.slow_s = 0.05
    node = make_node("planner", "planner")
    begin(node, settings)
    submit(client)
    until(lambda: len(f.commands) >= 3)
    node.__exit__(None, None, None)
    for path in tmp_path.glob("planner.sqlite*"):
        path.unlink()
    service = begin(make_node("planner", "planner"), settings)
    service._saved_s = 0.0
    service.step()
    (status,) = [answer.message for answer in client.ask_all(MISSION_STATUS)]
    assert (status.mission, status.state, status.error) == ("m1", "failed", "mission_lost")
    f.slow_s = 0.0
    submit(client, "m2")
    assert end_of(client, "m2").found
    (lost, found) = Store(settings.store, client).load()
    assert (lost.status.error, found.status.found) == ("mission_lost", True)


def test_a_memory_that_cannot_be_read_begins_anew_with_its_steps_counted(fakes, make_node, begin, client, tmp_path):
    settings = QUICK.model_copy(update={"store": str(tmp_path / "planner.sqlite")})
    f = fakes()
    f.slow_s = 0.05
    node = make_node("planner", "planner")
    begin(node, settings)
    submit(client)
    until(lambda: len(f.commands) >= 5)
    node.__exit__(None, None, None)
    store = Store(settings.store, client)
    (mission,) = store.load()
    store.save(msgspec.structs.replace(mission, memory='{"target": 7}'))
    store.close()
    begin(make_node("planner", "planner"), settings)
    status = end_of(client)
    assert status.found
    assert status.step == len(f.commands)
