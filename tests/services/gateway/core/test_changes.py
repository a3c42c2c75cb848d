"""What is worth an event."""

from __future__ import annotations

import json

import msgspec
import pytest

from surveilnav.messages import MissionStatus, ObjectRecord, ServiceState
from surveilnav.services.gateway.core import changes
from surveilnav.services.gateway.core.changes import CameraState, Change, RobotSituation, Tracked
from surveilnav.services.gateway.core.resources.event import Event

MISSION = MissionStatus(
    stamp_ns=1, mission="m", target="tv", robot="r1", state="active", phase="exploring", step=1, max_steps=9, path_m=1.0
)
OBJECT = ObjectRecord(
    id=3,
    floor="0",
    label="tv",
    status="candidate",
    confidence=float("nan"),
    confidence_robot=0.0,
    confidence_surveillance=0.0,
    label_robot="",
    label_surveillance="",
    n_detections=1,
    n_points=1,
    center_m=(1.0, float("inf"), 0.0),
    size_m=(1, 1, 1),
    first_seen_ns=1,
    last_seen_ns=1,
    sources=[],
    reason="r" * 5000,
)
CAMERA = CameraState("0", online=True, invoked=False)
ROBOT = RobotSituation(online=True, state="ready", floor="0")
PROCESS = ServiceState("fusion", True)


def but(known, /, **facts):
    return msgspec.structs.replace(known, **facts)


@pytest.mark.parametrize(
    ("rule", "before", "now", "what"),
    [
        (changes.of_mission, None, MISSION, ["active"]),
        (changes.of_mission, MISSION, but(MISSION, step=2, path_m=9.0), []),
        (changes.of_mission, MISSION, but(MISSION, phase="approaching"), ["phase"]),
        (changes.of_mission, MISSION, but(MISSION, state="done", phase="finished"), ["done"]),
        (changes.of_object, None, OBJECT, []),
        (changes.of_object, None, but(OBJECT, status="confirmed"), ["confirmed"]),
        (changes.of_object, OBJECT, but(OBJECT, status="rejected"), ["rejected"]),
        (changes.of_object, but(OBJECT, status="confirmed"), OBJECT, ["candidate"]),
        (changes.of_object, but(OBJECT, status="confirmed"), None, ["gone"]),
        (changes.of_object, OBJECT, None, []),
        (changes.of_camera, None, CAMERA, ["new"]),
        (changes.of_camera, None, CameraState("0", online=True, invoked=True), ["new", "invoked"]),
        (changes.of_camera, CAMERA, CameraState("0", online=False, invoked=False), ["offline"]),
        (changes.of_camera, CameraState("0", online=False, invoked=True), CAMERA, ["back", "released"]),
        (changes.of_camera, CAMERA, CAMERA, []),
        (changes.of_camera, CAMERA, CameraState("0", online=True, invoked=False, paused=True), ["paused"]),
        (changes.of_camera, CameraState("0", online=True, invoked=False, paused=True), CAMERA, ["resumed"]),
        (changes.of_robot, None, ROBOT, ["new"]),
        (changes.of_robot, ROBOT, RobotSituation(online=False, state="moving", floor="0"), ["silent"]),
        (changes.of_robot, ROBOT, RobotSituation(online=True, state="moving", floor="1"), ["moving", "floor"]),
        (changes.of_process, PROCESS, but(PROCESS, running=False, why="SIGKILL"), ["ended"]),
        (changes.of_process, but(PROCESS, running=False), but(PROCESS, restarts=1), ["restarted"]),
        (changes.of_process, PROCESS, but(PROCESS, restarts=1), ["restarted"]),
        (changes.of_process, PROCESS, but(PROCESS, running=False, given_up=True), ["given_up"]),
        (changes.of_presence, None, True, ["online"]),
        (changes.of_presence, True, None, ["offline"]),
    ],
)
def test_rules(rule, before, now, what):
    assert list(rule(before, now)) == what


def test_the_first_look_is_no_news():
    tracked = Tracked(changes.of_camera)
    assert tracked.update_one("c1", CAMERA) == []
    assert tracked.update({"c1": CAMERA}) == []
    assert tracked.update({"c1": CAMERA, "c2": CAMERA}) == [Change("c2", "new", CAMERA)]
    gone = CameraState("0", online=False, invoked=False)
    assert tracked.update_one("c1", gone) == [Change("c1", "offline", gone)]
    assert tracked.update({"c1": gone, "c2": CAMERA}) == []


def test_what_is_told_is_one_short_line_of_json_without_what_isnt_finite():
    line = Event.of_object(Change("3", "confirmed", OBJECT), 1_700_000_000_000_000_000).line()
    assert "\n" not in line
    assert len(line) < 1000
    told = json.loads(line)
    assert told["center_m"] == [1.0, None, 0.0]
    assert "confidence" not in told
    hostile = but(MISSION, message="a\nid: 9\n\nevent: x\n", target="\u2028\x85" * 9)
    assert "\n" not in Event.of_mission(Change("m", "active", hostile), 1).line()
