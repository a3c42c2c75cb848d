"""The whole system in a house of two floors: what a camera of the other floor costs, and how the robot gets there."""

from __future__ import annotations

import time

import pytest

from surveilnav.contract import ROBOT_STATUS
from surveilnav.messages import FINISHED_STATES
from tests.e2e.conftest import frame_bytes
from tests.waiting import until


@pytest.mark.slow
def test_only_cameras_of_the_robots_floor_send_frames(house):
    s = house
    floors = {c.name: c.floor for c in s.building.plan.cameras}
    assert set(floors.values()) == {"0", "1"}
    robots = until(lambda: s.node.ask_all(ROBOT_STATUS))  # its token may be there before it answers
    robot_floor = robots[0].message.floor
    here = [name for name, floor in floors.items() if floor == robot_floor]
    others = [name for name, floor in floors.items() if floor != robot_floor]
    until(lambda: all(frame_bytes(s.traffic("camera", name)) > 100_000 for name in here), timeout_s=60.0)
    began = {name: s.traffic("camera", name) for name in others}
    time.sleep(2.0)
    for name in others:
        ended = s.traffic("camera", name)
        assert frame_bytes(ended) == 0
        # What it still sends (traffic figures for this test, keep-alives) stays under 1 kB/s.
        sent_bytes = ended.wire_sent_bytes - began[name].wire_sent_bytes
        assert sent_bytes / ((ended.stamp_ns - began[name].stamp_ns) / 1e9) < 1000


@pytest.mark.slow
def test_over_the_stairs_to_the_only_floor_that_has_the_target(house):
    """The cameras' summaries tell the planner where to go; they cost hundreds of bytes."""
    s = house
    floors = {i.floor for i in s.building.scene.labelled("refrigerator")}
    assert floors == {"0"}, "this test needs a target that is on one floor only"
    s.search("refrigerator", max_steps=400)
    s.wait(lambda m: "cameras of floor 0 saw 'refrigerator'" in m.message, 180)
    ended = s.wait(lambda m: m.state in FINISHED_STATES, 300)
    assert (ended.state, ended.found, ended.floor) == ("done", True, "0"), ended
    robot = s.node.ask(ROBOT_STATUS, robot="r1").message
    assert robot.floor == "0"
    assert 500 < ended.floor_choice_bytes < 100_000
    for camera in s.building.plan.cameras:
        rows = [r for r in s.traffic("camera", camera.name).rows if "/summary" in r.key]
        assert rows, f"camera {camera.name} told nothing"
        assert all(r.n_bytes / r.messages <= 600 for r in rows)
