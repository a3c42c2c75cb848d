"""Resources from messages, and problems from names."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.gateway.core.problems import invalid, refusal
from services.gateway.core.resources import NEEDED, Mission, Readiness, Robot
from services.gateway.core.resources.base import utc
from surveilnav.geometry import Pose
from surveilnav.messages import MissionStatus, RobotStatus


def status(**changes: object) -> MissionStatus:
    facts: dict[str, object] = {
        "stamp_ns": 1,
        "mission": "m",
        "target": "tv",
        "robot": "",
        "state": "active",
        "phase": "exploring",
        "step": 1,
        "max_steps": 9,
        "path_m": 1.0,
    }
    return MissionStatus(**(facts | changes))  # type: ignore[arg-type]


@given(st.integers(-(2**63), 2**64))
def test_any_stamp_is_a_time_or_null(stamp_ns):
    time = utc(stamp_ns)
    assert time is None or abs(time.timestamp() - stamp_ns / 1e9) < 1e-3


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_isnt_finite_is_null(value):
    mission = Mission.from_status(status(path_m=value, distance_remaining_m=value), 1, True)
    assert (mission.path_m, mission.distance_remaining_m) == (None, None)


@pytest.mark.parametrize(
    ("state", "planner", "stale"),
    [
        ("active", True, False),
        ("active", False, True),
        ("queued", False, True),
        ("done", False, False),
        ("failed", False, False),
    ],
)
def test_a_finished_mission_is_never_stale(state, planner, stale):
    assert Mission.from_status(status(state=state), 1, planner).stale is stale


def test_a_robot_says_what_it_cant_reach():
    note = "robots reach 3 of 4 m²: no stair leads to level 1"
    told = RobotStatus(
        stamp_ns=1,
        robot="r1",
        floor="0",
        seq=0,
        state="ready",
        T_world_base=Pose((0, 0, 0), (0, 0, 0, 1)),
        notes=[note],
    )
    assert Robot.from_status(told, None, 1, False).notes == [note]


def test_readiness_names_what_is_missing_and_how_to_start_it():
    everything = {kind: {"x"} for kind, _ in NEEDED}
    assert Readiness.of(1, everything).ready
    assert Readiness.of(0, everything).missing == ["router"]
    for kind, command in NEEDED:
        readiness = Readiness.of(1, everything | {kind: set()})
        assert readiness.missing == [kind]
        assert command in readiness.checks[kind]


@pytest.mark.parametrize(
    ("name", "status"),
    [
        ("bad_target", 422),
        ("unknown_mission", 404),
        ("no_free_robot", 409),
        ("busy", 503),
        ("internal", 502),
        ("", 409),
    ],
)
def test_refusals_have_sensible_statuses(name, status):
    assert refusal(name, "why").status == status


def test_remote_text_in_a_problem_is_short():
    body = refusal("x" * 10_000, "y" * 10_000).body("/")
    assert len(body["type"]) < 100
    assert len(body["detail"]) <= 2000
    assert refusal("", "").body("/")["detail"]


def test_invalid_requests_say_where():
    body = invalid([{"type": "missing", "loc": ("body", "target"), "msg": "Field required", "input": "\ud800"}]).body(
        "/x"
    )
    assert (body["status"], body["detail"]) == (422, "body.target: Field required")
    assert body["errors"] == [{"where": "body.target", "message": "Field required"}]


S = 1_000_000_000


@pytest.mark.parametrize(
    ("facts", "elapsed", "remaining"),
    [
        ({"started_ns": S, "stamp_ns": 41 * S, "path_m": 10.0, "distance_remaining_m": 5.0}, 40.0, 20.0),
        ({"started_ns": S, "stamp_ns": 41 * S, "path_m": 0.9, "distance_remaining_m": 5.0}, 40.0, None),  # no pace yet
        ({"started_ns": S, "stamp_ns": 41 * S, "path_m": 10.0}, 40.0, None),  # no waypoint
        ({"started_ns": S, "finished_ns": 3 * S, "stamp_ns": 9 * S, "state": "done", "path_m": 9.0}, 2.0, None),
        ({"started_ns": 0, "stamp_ns": 9 * S, "path_m": 10.0, "distance_remaining_m": 5.0}, None, None),
        (
            {"started_ns": 9 * S, "stamp_ns": S, "path_m": 10.0, "distance_remaining_m": 5.0},
            None,
            None,
        ),  # clocks disagree
        ({"started_ns": S, "stamp_ns": 9 * S, "path_m": math.nan, "distance_remaining_m": 5.0}, 8.0, None),
        ({"started_ns": S, "stamp_ns": 9 * S, "path_m": 2.0, "distance_remaining_m": math.inf}, 8.0, None),
    ],
)
def test_times_of_a_mission(facts, elapsed, remaining):
    mission = Mission.from_status(status(**facts), 1, True)
    assert (mission.elapsed_s, mission.time_remaining_s) == (elapsed, remaining)
