"""ROS 2 over a real router: among ourselves, and with two implementations of rmw_zenoh's wire that aren't ours."""

from __future__ import annotations

import importlib.util
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from surveilnav.bus.router import free_port, open_router
from surveilnav.ros2 import types
from surveilnav.ros2.names import Qos
from surveilnav.ros2.navigate_to_pose import GoalPose, GoalStatus, NavigateToPose, NavigateToPoseServer
from surveilnav.ros2.session import RosError, RosMessage, RosSession
from tests.waiting import repeat_until, until

#: The header of little-endian CDR.
CDR = b"\x00\x01\x00\x00"
#: Of example_interfaces/srv/AddTwoInts, from rmw_zenoh's design.
ADD_HASH = "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
PEERS = Path(__file__).parent / "peers"
WAIT_S = 20.0


@pytest.fixture(scope="module")
def router() -> Iterator[str]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_router(endpoint):
        yield endpoint


@pytest.fixture
def session(router: str) -> Iterator[Callable[..., RosSession]]:
    """``session(node, domain=...)``: a node; it ends with the test."""
    with ExitStack() as stack:
        yield lambda node, **more: stack.enter_context(RosSession(node, router=router, **more))


def text(data: str) -> object:
    return types.make("std_msgs/msg/String", data=data)


def test_messages_arrive_with_number_time_and_sender(session):
    talker, listener = session("talker"), session("listener")
    received: list[RosMessage] = []
    listener.subscribe("/chatter", "std_msgs/msg/String", received.append)
    publisher = talker.publisher("chatter", "std_msgs/msg/String")
    until(lambda: listener.graph.endpoints("MP", "/chatter") and talker.graph.endpoints("MS", "/chatter"))
    repeat_until(lambda: publisher.put(text("hello")), lambda: received, timeout_s=WAIT_S)
    first = received[0]
    assert (first.topic, first.type_name, first.data.data) == ("/chatter", "std_msgs/msg/String", "hello")
    assert first.attachment is not None
    assert first.attachment.sequence >= 1
    assert abs(first.attachment.stamp_ns - first.received_ns) < 10**10


def test_a_late_subscription_gets_what_is_kept_for_it(session):
    robot, late = session("robot"), session("late")
    kept = Qos(transient_local=True, depth=1)
    publisher = robot.publisher("/map_name", "std_msgs/msg/String", kept)
    publisher.put(text("old"))
    publisher.put(text("ground floor"))
    received: list[str] = []
    late.subscribe("/map_name", "std_msgs/msg/String", lambda m: received.append(m.data.data), kept)
    until(lambda: received == ["ground floor"], lambda: received, timeout_s=WAIT_S)


def test_what_cannot_be_read_is_told_and_dropped(session):
    faults: list[str] = []
    received: list[RosMessage] = []
    sender, listener = session("sender"), session("listener", on_fault=faults.append)
    listener.subscribe("/odom", "nav_msgs/msg/Odometry", received.append)
    key = f"0/odom/nav_msgs::msg::dds_::Odometry_/{types.type_hash('nav_msgs/msg/Odometry')}"
    repeat_until(lambda: sender.zenoh.put(key, b"\x00\x01\x00\x00junk"), lambda: faults, timeout_s=WAIT_S)
    assert "/odom: expected a nav_msgs/msg/Odometry of 8 bytes as CDR" in faults[0]
    assert not received


class Driver:
    """Accepts goals, as Nav2 would."""

    def __init__(self, session: RosSession) -> None:
        self.goals: list[tuple[bytes, GoalPose]] = []
        self.accepts = True
        self.server = NavigateToPoseServer(session, self._accept, self._cancel)

    def _accept(self, id: bytes, pose: GoalPose) -> bool:
        self.goals.append((id, pose))
        return self.accepts

    def _cancel(self, id: bytes) -> bool:
        threading.Thread(target=self.server.end, args=(id, GoalStatus.CANCELED)).start()
        return True


def test_a_goal_is_accepted_followed_and_reached_or_cancelled(session):
    driver = Driver(session("nav2"))
    navigation = NavigateToPose(session("surveilnav"))
    wanted = GoalPose("map", 1.5, -2.0, 0.5)
    goal = navigation.send(wanted, timeout_s=WAIT_S)
    id, pose = driver.goals[0]
    assert (id, pose.frame, pose.x_m, pose.y_m) == (goal.id, "map", 1.5, -2.0)
    assert pose.yaw_rad == pytest.approx(0.5)
    here = GoalPose("map", 1.0, -1.0, 0.0)
    repeat_until(lambda: driver.server.tell_progress(goal.id, here, 1.25, 2), lambda: goal.progress, timeout_s=WAIT_S)
    assert (goal.progress.x_m, goal.progress.distance_remaining_m, goal.progress.recoveries) == (1.0, 1.25, 2)
    driver.server.end(goal.id, GoalStatus.SUCCEEDED)
    assert goal.wait(WAIT_S).status is GoalStatus.SUCCEEDED
    second = navigation.send(wanted, timeout_s=WAIT_S)
    assert navigation.cancel(second, timeout_s=WAIT_S)
    assert second.wait(WAIT_S).status is GoalStatus.CANCELED
    third = navigation.send(wanted, timeout_s=WAIT_S)
    driver.server.end(third.id, GoalStatus.ABORTED)
    assert third.wait(WAIT_S).why == "navigate_to_pose ended the goal: aborted"
    driver.accepts = False
    with pytest.raises(RosError, match=r"rejects the goal \(1\.50, -2\.00\) in frame 'map'"):
        navigation.send(wanted, timeout_s=WAIT_S)


def test_goals_are_waited_for_apart_and_say_why_they_ended(session):
    driver = Driver(session("nav2"))
    user, other = session("surveilnav"), NavigateToPose(session("other"))
    navigation = NavigateToPose(user)
    listed: list[list[int]] = []

    def record(message: RosMessage) -> None:
        listed.append([goal.status for goal in message.data.status_list])

    kept = Qos(transient_local=True, depth=1)
    user.subscribe("navigate_to_pose/_action/status", "action_msgs/msg/GoalStatusArray", record, kept)
    wanted = GoalPose("map", 1.5, -2.0, 0.5)
    first = navigation.send(wanted, timeout_s=WAIT_S)
    second, third = other.send(wanted, timeout_s=WAIT_S), other.send(wanted, timeout_s=WAIT_S)
    driver.server.end(third.id, GoalStatus.ABORTED, "no path")
    assert third.wait(WAIT_S).why == "navigate_to_pose ended the goal: aborted, no path"
    driver.server.end(second.id, GoalStatus.SUCCEEDED, "")
    assert second.wait(WAIT_S).why == ""
    assert first.result is None
    states = [GoalStatus.EXECUTING, GoalStatus.SUCCEEDED, GoalStatus.ABORTED]
    until(lambda: listed and listed[-1] == states, lambda: listed, timeout_s=WAIT_S)


def test_an_empty_goal_id_cancels_all_goals(session):
    driver = Driver(session("nav2"))
    user = session("surveilnav")
    navigation = NavigateToPose(user)
    goals = [navigation.send(GoalPose("map", x_m, 0.0, 0.0), timeout_s=WAIT_S) for x_m in (1.0, 2.0, 3.0)]
    driver.server.end(goals[0].id, GoalStatus.SUCCEEDED)
    assert goals[0].wait(WAIT_S).status is GoalStatus.SUCCEEDED
    nobody = types.make("unique_identifier_msgs/msg/UUID", uuid=np.zeros(16, np.uint8))
    stamp = types.make("builtin_interfaces/msg/Time", sec=0, nanosec=0)
    info = types.make("action_msgs/msg/GoalInfo", goal_id=nobody, stamp=stamp)
    request = types.make("action_msgs/srv/CancelGoal_Request", goal_info=info)
    response = user.call("navigate_to_pose/_action/cancel_goal", request, "action_msgs/srv/CancelGoal_Response", WAIT_S)
    assert len(response.goals_canceling) == 2
    assert [goal.wait(WAIT_S).status for goal in goals[1:]] == [GoalStatus.CANCELED] * 2


def test_a_service_that_is_not_there_and_one_of_another_domain(session):
    asking = session("asking", domain=3)
    session("serving").serve("/dock", "std_srvs/srv/Trigger", "std_msgs/msg/String", lambda _: text(""), "RIHS01_1")
    with pytest.raises(RosError, match="no service /dock in domain 3"):
        asking.call("/dock", text(""), "std_msgs/msg/String", timeout_s=0.3)


# --- implementations that aren't ours -----------------------------------------------------------------------------


@pytest.fixture
def peer(router: str, tmp_path: Path) -> Iterator[Callable[[str, str], subprocess.Popen[str]]]:
    """``peer(package, script)``: a node of another implementation in domain 7; skips where that isn't installed."""
    started: list[subprocess.Popen[str]] = []

    def start(package: str, script: str) -> subprocess.Popen[str]:
        if importlib.util.find_spec(package) is None:
            pytest.skip(f"{package} isn't installed: it comes with the extra [dev]")
        command = [sys.executable, str(PEERS / script), router, "7"]
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=tmp_path))
        assert started[-1].stdout.readline() == "ready\n"
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()


@pytest.mark.slow
@pytest.mark.timeout(600)  # pyzeros compiles its encoders when they are first used
def test_with_pyzeros(session, peer):
    robot = peer("pyzeros", "pyzeros_peer.py")
    node = session("surveilnav", domain=7, namespace="/r2")
    received: list[RosMessage] = []
    node.subscribe("odom", "nav_msgs/msg/Odometry", received.append)
    until(lambda: received, timeout_s=WAIT_S)
    assert (received[0].data.header.frame_id, received[0].data.pose.pose.position.x) == ("odom", 1.5)
    assert node.graph.endpoints("MP", "/r2/odom")[0].type_hash == types.type_hash("nav_msgs/msg/Odometry")
    publisher = node.publisher("cmd_vel", "geometry_msgs/msg/Twist")
    node.wait_for("MS", "/r2/cmd_vel", WAIT_S)
    publisher.put(twist(0.25, -0.5))
    assert robot.stdout.readline() == "twist 0.25 -0.50\n"
    assert b"docked" in node.call_encoded("dock", CDR + b"\0", WAIT_S)


def test_with_zenoh_ros2_sdk(session, peer):
    robot = peer("zenoh_ros2_sdk", "sdk_peer.py")
    node = session("surveilnav", domain=7)
    received: list[RosMessage] = []
    node.subscribe("/chatter", "std_msgs/msg/String", received.append)
    until(lambda: received, timeout_s=WAIT_S)
    assert received[0].data.data == "from the sdk"
    publisher = node.publisher("/said", "std_msgs/msg/String")
    node.wait_for("MS", "/said", WAIT_S)
    publisher.put(text("hello"))
    assert robot.stdout.readline() == "said hello\n"
    assert node.call_encoded("/add", CDR + struct.pack("<qq", 2, 40), WAIT_S) == CDR + struct.pack("<q", 42)
    assert node.graph.endpoints("SS", "/add")[0].type_hash == ADD_HASH


def twist(forward_m_s: float, turn_rad_s: float) -> object:
    def vector(x: float, z: float) -> object:
        return types.make("geometry_msgs/msg/Vector3", x=x, y=0.0, z=z)

    return types.make("geometry_msgs/msg/Twist", linear=vector(forward_m_s, 0.0), angular=vector(0.0, turn_rad_s))
