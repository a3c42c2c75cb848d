"""The planner over real Zenoh with a robot that drives to waypoints by itself and observes meanwhile."""

from __future__ import annotations

import math
import threading
import time

import msgspec
import pytest

from surveilnav.bus import Answer, Refused
from surveilnav.contract import MISSION_CANCEL, MISSION_PAUSE, MISSION_STATUS
from surveilnav.messages import (
    CommandReply,
    MissionCancel,
    MissionPause,
    RobotDescription,
    RobotFrameProblem,
    WaypointStatus,
)
from surveilnav.services.planner.config import PlannerSettings
from tests.services.planner.test_service import Fakes, begin, client, end_of, planner, submit  # noqa: F401
from tests.waiting import until

HALL = """
##############################
#                            #
#                            #
#   R                    CC  #
#                        CC  #
#                            #
##############################
"""
QUICK = PlannerSettings(late_s=0.1, ask_timeout_s=0.5, maps_timeout_s=3.0, robot_timeout_s=3.0, decision_period_s=0.2)
_TICK_S, _SPEED_M_S, _TURN_RAD_S = 0.02, 2.0, 6.0


class DrivingFakes(Fakes):
    """A robot that drives straight to where it is sent, as fast as a test likes it, and numbers what it sees meanwhile.

    ``not_ready``: why it takes no commands. ``rejects``: it fails every drive to another place.
    """

    def __init__(self, make_node, world):
        self.wanted, self.drive, self.drives, self.holds = None, None, [], 0
        self.not_ready, self.rejects = "", False
        super().__init__(make_node, {"0": world})
        self.running = True
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def status(self):
        description = RobotDescription(drive="waypoints", max_pitch_rad=0.0)
        return msgspec.structs.replace(super().status(), description=description, waypoint=self.drive)

    def command(self, request):
        command = request.message
        with self.lock:
            if command.seq_expected > self.world.seq:
                return Answer(CommandReply(stamp_ns=1, accepted=False, seq=self.world.seq, error="seq"))
            if self.not_ready and command.action != "stop":
                raise Refused("not_ready", self.not_ready)
            self.mission, self.last_action = command.mission, command.action
            self.commands.append(command.action)
            if command.action == "stop" or command.waypoint is None:
                self.wanted, self.holds = None, self.holds + (command.action == "drive_to")
            elif self.drive is None or self.drive.id != command.waypoint.id:
                self.wanted = command.waypoint
                self.drives.append(command.waypoint)
                self.drive = WaypointStatus(id=self.wanted.id, state="driving")
            self.world.seq += command.action == "stop"
            self.tell()
            return Answer(CommandReply(stamp_ns=1, accepted=True, seq=self.world.seq))

    def run(self):
        while self.running:
            time.sleep(_TICK_S)
            with self.lock:
                if self.wanted is not None:
                    self.move(self.wanted)
                    self.world.seq += 1
                    self.world.look()
                    self.tell()

    def move(self, pose):
        world = self.world
        away_m = math.hypot(pose.x_m - world.x, pose.y_m - world.y)
        if away_m > 0.05 and self.rejects:
            self.drive, self.wanted = WaypointStatus(id=pose.id, state="failed", why="no way, says Nav2"), None
            return
        if away_m > 0.05:
            step_m = min(away_m, _SPEED_M_S * _TICK_S)
            world.yaw = math.atan2(pose.y_m - world.y, pose.x_m - world.x)
            world.x += step_m * math.cos(world.yaw)
            world.y += step_m * math.sin(world.yaw)
            world.path_m += step_m
            return
        off_rad = math.remainder(pose.yaw_rad - world.yaw, 2 * math.pi)
        world.yaw += math.copysign(min(abs(off_rad), _TURN_RAD_S * _TICK_S), off_rad)
        if abs(off_rad) < 0.05:
            self.drive, self.wanted = WaypointStatus(id=pose.id, state="reached"), None


@pytest.fixture
def robot(make_node, world, thing):
    make_node("perception", "p1")
    fakes = DrivingFakes(make_node, world(HALL, {"C": thing("chair", looks_like="chair")}, yaw_rad=math.pi))
    yield fakes
    fakes.running = False
    fakes.thread.join()


def state_of(client):  # noqa: F811
    return client.ask(MISSION_STATUS, mission="m1").message


def test_it_is_sent_to_waypoints_and_finds(robot, planner, client):  # noqa: F811
    planner(QUICK)
    submit(client)
    status = end_of(client, timeout_s=60.0)
    assert (status.state, status.found) == ("done", True), status
    assert robot.world.gap_m("C") <= 1.1
    assert set(robot.commands) == {"drive_to", "stop"}
    assert robot.commands.count("drive_to") > len(robot.drives), "a drive is kept up, not begun anew"


def test_a_pause_holds_it_and_a_resumed_mission_drives_on(robot, planner, client):  # noqa: F811
    planner(QUICK)
    submit(client)
    until(lambda: len(robot.drives) >= 3)
    client.ask(MISSION_PAUSE, MissionPause(stamp_ns=1, mission="m1", paused=True), mission="m1", timeout_s=5)
    until(lambda: state_of(client).state == "paused")
    assert robot.holds >= 1
    assert robot.wanted is None
    sent = len(robot.drives)
    time.sleep(0.4)
    assert len(robot.drives) == sent, "a paused mission commands nothing"
    client.ask(MISSION_PAUSE, MissionPause(stamp_ns=1, mission="m1", paused=False), mission="m1", timeout_s=5)
    assert end_of(client, timeout_s=60.0).found


def test_a_cancel_ends_its_drive(robot, planner, client):  # noqa: F811
    planner(QUICK)
    submit(client)
    until(lambda: robot.drives)
    client.ask(MISSION_CANCEL, MissionCancel(stamp_ns=1, mission="m1", reason="enough"), mission="m1", timeout_s=5)
    assert end_of(client).state == "cancelled"
    assert robot.wanted is None


def test_a_robot_that_loses_its_place_pauses_the_mission_by_name(robot, planner, client):  # noqa: F811
    planner(QUICK)
    submit(client)
    until(lambda: robot.drives)
    robot.not_ready = "its localisation is lost: it knows its place to 0.8 m only"
    until(lambda: state_of(client).state == "paused")
    assert "isn't ready: its localisation is lost" in state_of(client).message
    robot.not_ready = ""
    client.ask(MISSION_PAUSE, MissionPause(stamp_ns=1, mission="m1", paused=False), mission="m1", timeout_s=5)
    assert end_of(client, timeout_s=60.0).found


def test_a_robot_that_isnt_where_it_says_pauses_the_mission_once(robot, planner, client):  # noqa: F811
    """Whoever resumes it nevertheless is obeyed."""
    planner(QUICK)
    submit(client)
    until(lambda: robot.drives)
    robot.frames = [
        RobotFrameProblem("other", "robot other isn't where it says", 9.0, 0.0, 0.0),
        RobotFrameProblem("r1", "robot r1 isn't where it says", 0.5, 0.0, 0.0),
    ]
    until(lambda: state_of(client).state == "paused")
    assert state_of(client).message == "robot r1 isn't where it says"
    client.ask(MISSION_PAUSE, MissionPause(stamp_ns=1, mission="m1", paused=False), mission="m1", timeout_s=5)
    assert end_of(client, timeout_s=60.0).found


def test_ways_that_its_own_navigation_rejects_end_the_mission_with_that_reason(robot, planner, client):  # noqa: F811
    robot.rejects = True
    planner(QUICK)
    submit(client)
    status = end_of(client, timeout_s=90.0)
    assert status.state == "failed"
    assert status.error in ("stuck", "unreachable", "not_found")
    assert status.error == "stuck" or "no way, says Nav2" in status.message


@pytest.mark.parametrize("nonsense", [{"radius_m": -1.0}, {"hfov_rad": 0.0}, {"camera_height_m": float("nan")}])
def test_a_description_that_cannot_be_is_refused_by_name(robot, planner, client, nonsense):  # noqa: F811
    real = robot.status
    description = RobotDescription(drive="waypoints", **nonsense)
    robot.status = lambda: msgspec.structs.replace(real(), description=description)
    planner(QUICK)
    submit(client)
    status = end_of(client, timeout_s=20.0)
    assert (status.state, status.error) == ("failed", "robot_lost")
    assert "its description can't be" in status.message
