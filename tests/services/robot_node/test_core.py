from __future__ import annotations

import pytest

from surveilnav.messages import ACTIONS
from surveilnav.robot_state import RobotState
from surveilnav.services.robot_node.core import HaltState, is_view_due, reported_state


@pytest.mark.parametrize(
    ("stopped", "halted", "late", "awaiting", "name"),
    [
        (False, False, False, False, "ready"),
        (False, False, False, True, "moving"),
        (False, False, True, True, "stopped"),
        (True, False, False, False, "stopped"),
        (True, True, True, True, "halted"),
        (False, True, False, True, "halted"),
    ],
)
def test_what_it_says_that_it_does(stopped, halted, late, awaiting, name):
    state = RobotState(0.0, 0.0, 0.0, "0", 0.0, stopped=stopped)
    assert reported_state(state, HaltState(halted), deadline_missed=late, awaiting_command=awaiting) == name


@pytest.mark.parametrize("action", ACTIONS)
def test_only_stop_is_done_by_a_halted_robot(action):
    assert HaltState().refusal(action) == ""
    assert bool(HaltState(True, "fire").refusal(action)) == (action != "stop")


@pytest.mark.parametrize(
    ("moved_m", "turned_rad", "elapsed_s", "due"),
    [
        (0.2, 0.0, 0.6, True),
        (0.0, 0.2, 0.6, True),
        (0.2, 0.2, 0.4, False),  # too soon
        (0.1, 0.1, 4.9, False),  # it stands: the same again would count as evidence
        (0.0, 0.0, 5.1, True),
    ],
)
def test_a_driving_robot_takes_a_view_once_it_has_moved(moved_m, turned_rad, elapsed_s, due):
    last = RobotState(1.0, 2.0, 0.0, "0", 3.1)
    now = RobotState(1.0 + moved_m, 2.0, 0.0, "0", 3.1 + turned_rad - 2 * 3.141592653589793)
    assert is_view_due(last, now, elapsed_s, 0.5) == due
    assert is_view_due(None, now, 0.0, 0.5)
