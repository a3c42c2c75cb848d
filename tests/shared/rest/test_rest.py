"""The resources: examples that fit them, numbers that are none, constants that stand elsewhere too, and what they import."""

from __future__ import annotations

import subprocess
import sys

import pytest

from surveilnav import contract, messages, rest
from surveilnav.rest import examples

EXAMPLES = [
    (rest.NewMission, examples.NEW_MISSION),
    (rest.Mission, examples.MISSION),
    (rest.MissionPlan, examples.PLAN),
    (rest.Object, examples.OBJECT),
    (rest.Robot, examples.ROBOT),
    (rest.Camera, examples.CAMERA),
    (rest.Recording, examples.RECORDING),
    (rest.Recorder, examples.RECORDER),
    (rest.Replay, examples.REPLAY),
]


@pytest.mark.parametrize(("model", "example"), EXAMPLES)
def test_an_example_comes_out_as_it_goes_in(model, example):
    assert set(example) == set(model.model_fields)
    assert model.model_validate(example).model_dump(mode="json") == example
    assert model.model_json_schema()["example"] == example


def test_what_a_newer_gateway_adds_is_ignored():
    assert rest.Mission.model_validate(examples.MISSION | {"colour": "red"}) == rest.Mission(**examples.MISSION)


@pytest.mark.parametrize("state", ["queued", "active", "confirming", "paused", "done", "failed", "cancelled"])
def test_a_mission_has_ended_in_the_states_that_the_bus_knows(state):
    mission = rest.Mission(**examples.MISSION | {"state": state})
    assert mission.has_ended == (state in messages.FINISHED_STATES)


def test_constants_of_the_bus_are_the_same_here():
    """They stand here, too, so that the resources need no message of the bus."""
    assert rest.ID_PATTERN == contract.ID_PATTERN
    assert rest.FINISHED_STATES == messages.FINISHED_STATES
    assert (rest.recordings.SLOWEST_REPLAY, rest.recordings.FASTEST_REPLAY) == (
        messages.SLOWEST_REPLAY,
        messages.FASTEST_REPLAY,
    )


def test_a_live_state_is_a_resource_of_its_kind():
    found = rest.LiveState.of_kind("mission", {"id": "m", "state": examples.MISSION})
    assert found.state == rest.Mission(**examples.MISSION)
    total = {
        "offered_bytes": 1,
        "delivered_bytes": 1,
        "wire_sent_bytes": None,
        "nodes": [],
        "cameras": [],
        "robots": [],
    }
    assert isinstance(rest.LiveState.of_kind("traffic", {"id": "total", "state": total}).state, rest.Traffic)
    assert rest.LiveState.of_kind("mission", {"id": "m", "state": None}).state is None
    assert rest.LiveState.of_kind("lift", {"id": "1", "state": {"floor": 3}}).state == {"floor": 3}, "a kind to come"
    assert rest.LiveState.of_kind("reset", {"why": "restarted", "do": "forget"}).why == "restarted"


@pytest.mark.parametrize("module", ["surveilnav.rest", "surveilnav.client"])
def test_the_client_and_its_resources_need_no_arrays_no_bus_and_no_server(module):
    heavy = {"numpy", "msgspec", "fastapi", "starlette", "zenoh", "cv2"}
    code = f"import sys, {module}; print(*sorted({heavy!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True, check=True)
    assert done.stdout.split() == []
