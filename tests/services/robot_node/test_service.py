"""The robot service over real Zenoh, with a body made here."""

from __future__ import annotations

import dataclasses
import threading
import time

import msgspec
import numpy as np
import pytest

from surveilnav.bus import Answer, Refused, Unanswered, clock_ns
from surveilnav.contract import (
    JUDGED,
    MISSION_STATUS,
    ROBOT_COMMAND,
    ROBOT_HALT,
    ROBOT_OBSERVATION,
    ROBOT_STATUS,
    TRUTH,
)
from surveilnav.geometry import Pinhole, yaw_of
from surveilnav.messages import (
    Command,
    Halt,
    MissionStatus,
    RobotDescription,
    RobotStatus,
    Stair,
    WaypointPose,
    WaypointStatus,
)
from surveilnav.robot_state import RobotState
from surveilnav.sensing.packing import decode_frame
from surveilnav.sensing.truth import truth_from_wire
from surveilnav.sensing.views import TrueInstances
from surveilnav.services.robot_node.bodies.body import ActionBody, Observation
from surveilnav.services.robot_node.config import RobotSettings
from surveilnav.services.robot_node.core import HaltState
from surveilnav.services.robot_node.halt_switch import HaltSwitch
from surveilnav.services.robot_node.service import RobotService
from surveilnav.services.robot_node.simulated import serve_truth
from tests.waiting import patient, until, until_heard

STAIR = Stair(floor="0", to_floor="1", at_m=(0.0, 0.0, 0.0), to_m=(1.0, 1.0, 2.7), length_m=3.0)


class Body(ActionBody):
    """A robot that walks along x, stops at a wall at x = 0.4 m, and can't fly."""

    stairs = (STAIR,)
    notes = ("robots reach 3 of 4 m²",)

    def __init__(self):
        self.state = RobotState(0.0, 0.0, 0.0, "0", 0.5)
        self.halts = 0

    def refusal(self, action, to_floor=None):
        return "it has no wings" if action == "look_up" else ""

    def begin_mission(self, mission):
        self.state = dataclasses.replace(self.state, path_m=0.0, last_action=None, stopped=False, mission=mission)

    def act(self, action, to_floor=None):
        s = self.state
        x_m = min(0.4, s.x_m + 0.25) if action == "move_forward" else s.x_m
        self.state = dataclasses.replace(
            s,
            seq=s.seq + 1,
            x_m=x_m,
            path_m=s.path_m + x_m - s.x_m,
            last_action=action,
            stopped=action == "stop",
            collided=action == "move_forward" and x_m - s.x_m < 0.25,
        )

    def halt(self):
        self.halts += 1

    def observe(self):
        T, s = self.state.camera_pose(0.7), self.state
        rgb, depth_m = np.full((8, 8, 3), 40 + s.seq, np.uint8), np.full((8, 8), 2.0, np.float32)
        return Observation(s, T, Pinhole.from_hfov(8, 8, 1.0), 0.7, (0.5, 5.0), rgb, depth_m)


@pytest.fixture
def client(make_node):
    return patient(make_node("test", "t", alive=False))


@pytest.fixture
def robot(make_node, client):
    """``robot(body)``: a service whose loop the test turns, and that others can reach."""

    def start(body, **settings):
        service = RobotService(make_node("robot", "r1"), body, RobotSettings(**settings))
        until_heard(lambda: client.ask(ROBOT_STATUS, robot="r1"))
        return service

    return start


@pytest.fixture
def command(client):
    """``command(action, seq)``: the reply to one command."""

    def send(action, seq, mission="m1", **more):
        message = Command(stamp_ns=clock_ns(), action=action, seq_expected=seq, mission=mission, **more)
        return client.ask(ROBOT_COMMAND, message, robot="r1").message

    return send


def test_it_says_what_it_did_in_status_and_observation_alike(robot, client, command):
    service = robot(Body())
    observations = client.latest(ROBOT_OBSERVATION, robot="r1")
    status = client.ask(ROBOT_STATUS, robot="r1").message
    assert (status.seq, status.last_action, status.collided, status.path_m) == (0, None, False, 0.0)
    assert status.stairs == [STAIR]
    assert status.notes == ["robots reach 3 of 4 m²"]
    for seq, path_m, collided in ((1, 0.25, False), (2, 0.4, True)):
        reply = command("move_forward", seq - 1)
        assert (reply.accepted, reply.seq) == (True, seq)
        assert service.step()
        status, seen = client.ask(ROBOT_STATUS, robot="r1").message, until(observations.poll)
        for said in (status, seen.message):
            assert (said.seq, said.last_action, said.collided) == (seq, "move_forward", collided)
            assert said.path_m == pytest.approx(path_m)
            assert said.T_world_base.translation_m[0] == pytest.approx(path_m)
        assert decode_frame(seen.message, seen.payload).rgb.mean() == pytest.approx(40 + seq, abs=2)
    assert status.state == "moving"
    assert yaw_of(status.T_world_base.matrix()) == pytest.approx(0.5)
    assert seen.message.mounting_offset_m == 0.7


def planner_of(make_node, target):
    """A planner that knows of one mission."""
    planner = make_node("planner", "p1")
    status = MissionStatus(
        stamp_ns=1, mission="m1", target=target, robot="r1", state="active", phase="", step=1, max_steps=9, path_m=0.0
    )
    planner.serve(MISSION_STATUS, lambda _: Answer(status), mission="m1")
    return planner


@pytest.mark.parametrize("says", [(True, 0.05), (False, None)])
def test_a_stop_at_what_was_found_is_judged_and_told_to_whoever_asks(make_node, client, command, says):
    asked = []

    def judge(target, state):
        asked.append((target, state.stopped))
        return says

    planner = planner_of(make_node, "tv")
    RobotService(make_node("robot", "r1"), Body(), RobotSettings(), judge)
    until_heard(lambda: client.ask(ROBOT_STATUS, robot="r1"))
    until_heard(lambda: client.ask(MISSION_STATUS, mission="m1"))
    heard = client.table(JUDGED)
    command("move_forward", 0)
    command("stop", 1)
    command("stop", 2, found=True)
    verdict = until(heard.rows)[0].message
    assert (verdict.mission, verdict.robot, verdict.success, verdict.distance_m) == ("m1", "r1", *says)
    assert asked == [("tv", True)], "neither a move nor the stop of a mission that failed is judged"
    assert [row.message for row in client.ask_all(JUDGED)] == [verdict]
    del planner


def test_a_real_robot_has_no_judge(robot, client, command, make_node):
    planner = planner_of(make_node, "tv")
    robot(Body())
    command("stop", 0, found=True)
    assert client.ask_all(JUDGED, timeout_s=0.5) == []
    del planner


def test_a_command_to_all_robots_moves_none(robot, client):
    service = robot(body := Body())
    everybody = Command(stamp_ns=clock_ns(), action="move_forward", seq_expected=0, mission="m1")
    assert client.ask_all(ROBOT_COMMAND, everybody, timeout_s=0.5) == []
    assert (service.step(), body.state.seq) == (True, 0), "only its first look is put"


def test_a_new_mission_counts_from_zero_unless_its_command_is_refused(robot, client, command):
    service = robot(Body())
    command("move_forward", 0)
    with pytest.raises(Refused, match="no wings") as refused:
        command("look_up", 1, mission="m2")
    assert refused.value.name == "bad_command"
    assert client.ask(ROBOT_STATUS, robot="r1").message.path_m == 0.25
    command("turn_left", 1, mission="m2")
    status = client.ask(ROBOT_STATUS, robot="r1").message
    assert (status.seq, status.path_m, status.last_action, status.mission) == (2, 0.0, "turn_left", "m2")
    command("stop", 2, mission="m2")
    assert client.ask(ROBOT_STATUS, robot="r1").message.state == "stopped"
    assert service.step()


def test_a_command_for_another_observation_changes_nothing(robot, client, command):
    body = Body()
    robot(body)
    reply = command("move_forward", 4)
    assert (reply.accepted, reply.seq) == (False, 0)
    assert "expected sequence number 0, got 4" in reply.error
    assert body.state.seq == 0


def test_without_a_command_before_the_deadline_it_says_that_it_stopped(robot, client, command):
    service = robot(Body())
    command("turn_left", 0, deadline_ms=1)
    time.sleep(0.05)
    service.step()
    status = client.ask(ROBOT_STATUS, robot="r1").message
    assert status.state == "stopped"
    assert "deadline" in status.message
    command("turn_left", 1)
    assert client.ask(ROBOT_STATUS, robot="r1").message.state == "moving"


def test_the_newest_observation_is_there_for_who_missed_it(robot, client):
    service = robot(Body())
    service.step()
    missed = client.ask(ROBOT_OBSERVATION, robot="r1")
    assert missed.message.seq == client.ask(ROBOT_STATUS, robot="r1").message.seq
    assert missed.payload


class Simulated(Body):
    """A body that knows what the observation with the number 3 shows."""

    def truth(self, seq):
        return TrueInstances(np.full((8, 8), 5, np.uint16), {5: "bed"}) if seq == 3 else None


def test_a_simulator_tells_who_asks_what_each_pixel_shows(make_node, client):
    serve_truth(make_node("robot", "r1"), "r1", Simulated())
    told = until_heard(lambda: client.ask(TRUTH, source="robot-r1", view=0, parameters={"seq": "3"}))
    assert (told.message.source, told.message.view, told.message.seq) == ("robot/r1", 0, 3)
    truth = truth_from_wire(told.message, told.payload)
    assert (truth.ids == 5).all()
    assert truth.labels == {5: "bed"}
    for seq in ("4", "", "-3"):
        with pytest.raises(Refused, match="one of the robot's newest views") as refused:
            client.ask(TRUTH, source="robot-r1", view=0, parameters={"seq": seq})
        assert refused.value.name == "no_truth"


def test_a_robot_tells_no_truth_unless_a_simulator_has_it_do_so(robot, client, make_node):
    service = robot(Simulated())
    service.step()
    assert client.ask(ROBOT_OBSERVATION, robot="r1").payload
    with pytest.raises(Unanswered, match="nobody is there"):
        make_node("test", "u", alive=False).ask(TRUTH, source="robot-r1", view=0, parameters={"seq": "0"})


def test_a_status_of_an_older_sender_still_decodes(robot, client):
    robot(Body())
    plain = msgspec.msgpack.decode(msgspec.msgpack.encode(client.ask(ROBOT_STATUS, robot="r1").message))
    for name in ("collided", "last_action", "path_m"):
        plain.pop(name, None)
    status = msgspec.msgpack.decode(msgspec.msgpack.encode(plain), type=RobotStatus)
    assert (status.collided, status.last_action, status.path_m) == (False, None, 0.0)


def halt(client, *, halted=True, reason="smoke"):
    """Asks all robots, as who stops everything does."""
    return [row.message for row in client.ask_all(ROBOT_HALT, Halt(stamp_ns=clock_ns(), halted=halted, reason=reason))]


def test_a_halted_robot_refuses_to_move_until_it_is_released(robot, client, command):
    body = Body()
    robot(body)
    assert command("move_forward", 0).accepted
    assert [(r.robot, r.halted) for r in halt(client)] == [("r1", True)]
    assert body.halts
    status = client.ask(ROBOT_STATUS, robot="r1").message
    assert (status.state, status.seq) == ("halted", 1)
    assert "smoke" in status.message
    for action in ("move_forward", "turn_left", "take_stairs"):
        with pytest.raises(Refused, match="smoke") as refused:
            command(action, 1)
        assert refused.value.name == "halted"
    assert body.state.seq == 1
    assert command("stop", 1).accepted, "a mission may be cancelled meanwhile"
    assert client.ask(ROBOT_STATUS, robot="r1").message.state == "halted"
    assert [r.halted for r in halt(client, halted=False)] == [False]
    assert command("move_forward", 2).accepted
    assert client.ask(ROBOT_STATUS, robot="r1").message.state == "moving"


def test_a_halt_ends_the_action_under_way_and_answers_then(robot, client, command):
    class Slow(Body):
        """Its actions take for ever, unless it is halted."""

        def __init__(self):
            super().__init__()
            self.acting, self.braked = threading.Event(), threading.Event()

        def act(self, action, to_floor=None):
            self.acting.set()
            assert self.braked.wait(20)
            super().act(action, to_floor)

        def halt(self):
            super().halt()
            if self.halts > 1:  # the first comes too early, as for a command that has just slipped in
                self.braked.set()

    body = Slow()
    robot(body)
    moving = threading.Thread(target=lambda: command("move_forward", 0), daemon=True)
    moving.start()
    assert body.acting.wait(10)
    assert [r.halted for r in halt(client)] == [True]
    assert body.braked.is_set()
    moving.join(10)
    assert body.state.seq == 1


def test_another_halts_reason_is_cut(robot, client):
    robot(Body())
    halt(client, reason="x" * 100_000)
    assert len(client.ask(ROBOT_STATUS, robot="r1").message.message) < 500


def test_a_halt_outlives_the_process(tmp_path):
    store = str(tmp_path / "robot.bin")
    HaltSwitch(store).set(True, "smoke")
    again = HaltSwitch(store)
    assert (again.state.halted, again.state.reason) == (True, "smoke")
    again.set(False, "")
    assert not HaltSwitch(store).state.halted
    HaltSwitch(store).set(True, "")
    assert HaltSwitch(store).state == HaltState(True, "")


def test_a_halt_that_cant_be_kept_still_stops_the_robot(tmp_path):
    (tmp_path / "file").write_text("no folder")
    switch = HaltSwitch(str(tmp_path / "file" / "robot.bin"))
    switch.set(True, "smoke")
    assert switch.state.halted
    switch.set(False, "")
    assert not switch.state.halted


def test_a_halt_that_cant_be_kept_is_told_and_kept_once_there_is_room(robot, client, tmp_path):
    (tmp_path / "file").write_text("no folder")
    store = str(tmp_path / "file" / "robot.bin")
    service = robot(Body(), store=store)
    halt(client, reason="smoke")
    told = lambda: client.ask(ROBOT_STATUS, robot="r1").message.notes  # noqa: E731
    assert any("whether it is halted can't be saved" in note for note in told())
    (tmp_path / "file").unlink()
    service.step()
    assert told() == list(Body.notes)
    assert HaltSwitch(store).state == HaltState(True, "smoke")


def test_a_robot_that_was_halted_comes_back_halted(robot, client, command, tmp_path):
    store = str(tmp_path / "robot.bin")
    HaltSwitch(store).set(True, "smoke")
    robot(Body(), store=store)
    with pytest.raises(Refused, match="smoke"):
        command("move_forward", 0)
    halt(client, halted=False)
    assert command("move_forward", 0).accepted


class DrivingBody(Body):
    """A robot that drives by itself: as far as the test says."""

    description = RobotDescription(drive="waypoints")

    def __init__(self):
        super().__init__()
        self.problem, self.waypoint, self.sent = "", None, []

    def refusal(self, action, to_floor=None):
        return "" if action in ("drive_to", "stop") else "it drives by itself"

    def drive_to(self, waypoint):
        self.sent.append(waypoint)
        self.waypoint = waypoint and WaypointStatus(id=waypoint.id, state="driving")

    def observe(self):
        self.state = dataclasses.replace(self.state, seq=self.state.seq + 1)
        return super().observe()

    def move(self, x_m):
        self.state = dataclasses.replace(self.state, x_m=self.state.x_m + x_m)


THERE = WaypointPose(id="7", x_m=3.0, y_m=0.0, yaw_rad=0.0)


def test_a_robot_that_drives_by_itself_observes_meanwhile_and_takes_commands_for_older_views(robot, client, command):
    body = DrivingBody()
    service = robot(body, observation_hz=10)
    assert service.step()
    assert not service.step(), "it stands still, and has just looked"
    assert command("drive_to", 0, waypoint=THERE).accepted
    assert body.sent == [THERE]
    body.move(0.5)
    until(service.step)
    status = client.ask(ROBOT_STATUS, robot="r1").message
    assert (status.seq, status.description.drive, status.waypoint.id) == (2, "waypoints", "7")
    assert command("drive_to", 1, waypoint=None).accepted, "decided on an older view"
    assert body.sent[-1] is None
    assert not command("drive_to", 9, waypoint=THERE).accepted


def test_a_robot_that_drives_by_itself_stops_without_further_commands(robot, client, command):
    body = DrivingBody()
    service = robot(body)
    command("drive_to", 0, waypoint=THERE, deadline_ms=50)
    until(lambda: [service.step()] and body.halts)
    assert "no command came before the deadline" in client.ask(ROBOT_STATUS, robot="r1").message.message


def test_a_robot_that_is_not_ready_says_why_and_takes_only_a_stop(robot, client, command):
    body = DrivingBody()
    robot(body)
    body.problem = "its localisation is lost"
    status = client.ask(ROBOT_STATUS, robot="r1").message
    assert (status.state, status.message) == ("error", "its localisation is lost")
    with pytest.raises(Refused, match="localisation is lost") as refused:
        command("drive_to", 0, waypoint=THERE)
    assert refused.value.name == "not_ready"
    assert command("stop", 0).accepted
