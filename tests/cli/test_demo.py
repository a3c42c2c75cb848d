"""How a demo's search is judged."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from surveilnav.cli import demo
from surveilnav.messages import MissionStatus


@pytest.mark.parametrize(
    ("state", "found", "last_action", "stopped"),
    [
        ("done", True, "stop", True),
        ("failed", False, "stop", False),  # out of steps, and the robot was told to stop where it stood
        ("cancelled", False, "stop", False),
        ("done", True, "turn_left", False),
    ],
)
def test_only_a_stop_of_a_mission_that_found_its_target_is_judged(monkeypatch, state, found, last_action, stopped):
    judged = []
    monkeypatch.setattr(demo, "judge", lambda goals, robot, *, shortest_path_m: judged.append(robot.stopped))
    status = MissionStatus(
        stamp_ns=1,
        mission="m1",
        target="tv",
        robot="r1",
        state=state,
        phase="",
        step=9,
        max_steps=9,
        path_m=0.0,
        found=found,
    )
    pose = SimpleNamespace(translation_m=(1.0, 2.0, 0.0))
    last = SimpleNamespace(T_world_base=pose, floor="0", path_m=3.0, last_action=last_action)
    demo._judge(SimpleNamespace(observations={4: (last, None)}), status, None, SimpleNamespace(shortest_path_m=1.0))
    assert judged == [stopped]
