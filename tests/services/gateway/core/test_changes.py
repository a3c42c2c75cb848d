"""What is worth an event."""

from __future__ import annotations

import json
from dataclasses import replace

import msgspec
import pytest

from surveilnav.messages import MissionStatus, ObjectRecord, ServiceState
from surveilnav.services.gateway.core import changes
from surveilnav.services.gateway.core.changes import CameraState, Change, RobotSituation, Tracked

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
        (changes.mission_changes, None, MISSION, ["active"]),
        (changes.mission_changes, MISSION, but(MISSION, step=2, path_m=9.0), []),
        (changes.mission_changes, MISSION, but(MISSION, phase="approaching"), ["phase"]),
        (changes.mission_changes, MISSION, but(MISSION, state="done", phase="finished"), ["done"]),
        (changes.object_changes, None, OBJECT, []),
        (changes.object_changes, None, but(OBJECT, status="confirmed"), ["confirmed"]),
        (changes.object_changes, OBJECT, but(OBJECT, status="rejected"), ["rejected"]),
        (changes.object_changes, but(OBJECT, status="confirmed"), OBJECT, ["candidate"]),
        (changes.object_changes, but(OBJECT, status="confirmed"), None, ["gone"]),
        (changes.object_changes, OBJECT, None, []),
        (changes.camera_changes, None, CAMERA, ["new"]),
        (changes.camera_changes, None, CameraState("0", online=True, invoked=True), ["new", "invoked"]),
        (changes.camera_changes, CAMERA, CameraState("0", online=False, invoked=False), ["offline"]),
        (changes.camera_changes, CameraState("0", online=False, invoked=True), CAMERA, ["back", "released"]),
        (changes.camera_changes, CAMERA, CAMERA, []),
        (changes.camera_changes, CAMERA, CameraState("0", online=True, invoked=False, paused=True), ["paused"]),
        (changes.camera_changes, CameraState("0", online=True, invoked=False, paused=True), CAMERA, ["resumed"]),
        (changes.camera_changes, CAMERA, replace(CAMERA, quarantined=True), ["quarantined"]),
        (changes.camera_changes, replace(CAMERA, quarantined=True), CAMERA, ["believed"]),
        (changes.robot_changes, None, ROBOT, ["new"]),
        (changes.robot_changes, ROBOT, RobotSituation(online=False, state="moving", floor="0"), ["silent"]),
        (changes.robot_changes, ROBOT, RobotSituation(online=True, state="moving", floor="1"), ["moving", "floor"]),
        (changes.robot_changes, ROBOT, replace(ROBOT, frame_problem="off"), ["frame_disagrees"]),
        (changes.robot_changes, replace(ROBOT, frame_problem="off"), replace(ROBOT, frame_problem="by more"), []),
        (changes.robot_changes, replace(ROBOT, frame_problem="off"), ROBOT, ["frame_agrees"]),
        (changes.process_changes, PROCESS, but(PROCESS, running=False, why="SIGKILL"), ["ended"]),
        (changes.process_changes, but(PROCESS, running=False), but(PROCESS, restarts=1), ["restarted"]),
        (changes.process_changes, PROCESS, but(PROCESS, restarts=1), ["restarted"]),
        (changes.process_changes, PROCESS, but(PROCESS, running=False, given_up=True), ["given_up"]),
        (changes.presence_changes, None, True, ["online"]),
        (changes.presence_changes, True, None, ["offline"]),
    ],
)
def test_rules(rule, before, now, what):
    assert list(rule(before, now)) == what


def test_the_first_look_is_no_news():
    tracked = Tracked(changes.camera_changes)
    assert tracked.update_one("c1", CAMERA) == []
    assert tracked.update({"c1": CAMERA}) == []
    assert tracked.update({"c1": CAMERA, "c2": CAMERA}) == [Change("c2", "new", CAMERA)]
    gone = CameraState("0", online=False, invoked=False)
    assert tracked.update_one("c1", gone) == [Change("c1", "offline", gone)]
    assert tracked.update({"c1": gone, "c2": CAMERA}) == []


def test_what_is_told_is_one_short_line_of_json_without_what_isnt_finite():
    event = changes.object_event(Change("3", "confirmed", OBJECT), 1_700_000_000_000_000_000)
    line = event.model_dump_json(exclude_none=True)
    assert "\n" not in line
    assert len(line) < 1000
    told = json.loads(line)
    assert told["center_m"] == [1.0, None, 0.0]
    assert "confidence" not in told
    hostile = but(MISSION, message="a\nid: 9\n\nevent: x\n", target="\u2028\x85" * 9)
    assert "\n" not in changes.mission_event(Change("m", "active", hostile), 1).model_dump_json(exclude_none=True)
