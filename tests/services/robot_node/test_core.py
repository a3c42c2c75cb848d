from __future__ import annotations

import pytest

from surveilnav.messages import ACTIONS
from surveilnav.robot_state import RobotState
from surveilnav.services.robot_node.core import HaltState, reported_state


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
