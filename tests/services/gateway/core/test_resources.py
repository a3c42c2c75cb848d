"""Resources from messages, and problems from names."""

from __future__ import annotations

import math
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.geometry import Pose
from surveilnav.messages import MissionStatus, ObjectEvent, ObjectRecord, RobotStatus
from surveilnav.services.gateway.core.missions import mission_from_status
from surveilnav.services.gateway.core.problems import Problem, invalid, refusal
from surveilnav.services.gateway.core.resources import (
    NEEDED,
    object_from_record,
    readiness_from_nodes,
    robot_from_status,
    utc,
)
from surveilnav.services.gateway.core.selection import page_after


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
    mission = mission_from_status(status(path_m=value, distance_remaining_m=value), 1, True)
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
    assert mission_from_status(status(state=state), 1, planner).stale is stale


@pytest.mark.parametrize(
    ("state", "found", "judged", "said"),
    [
        ("done", True, True, True),
        ("done", True, False, False),
        ("done", True, None, None),
        ("cancelled", False, False, None),
        ("active", False, True, None),
    ],
)
def test_a_verdict_counts_where_a_mission_ended_by_its_stop(state, found, judged, said):
    assert mission_from_status(status(state=state, found=found), 1, True, judged).judged is said


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
    assert robot_from_status(told, None, 1, False).notes == [note]


def test_an_objects_times_are_those_of_its_messages_stamps():
    event = ObjectEvent(2_000_000_000, "camera/c1", 3, 1, "couch", math.nan, "created")
    record = ObjectRecord(
        id=1,
        floor="0",
        label="couch",
        status="candidate",
        confidence=0.5,
        confidence_robot=0.0,
        confidence_surveillance=0.5,
        label_robot="",
        label_surveillance="couch",
        n_detections=1,
        n_points=1,
        center_m=(1.0, math.inf, 0.0),
        size_m=(1.0, 1.0, 1.0),
        first_seen_ns=1_000_000_000,
        last_seen_ns=3_000_000_000,
        sources=["camera/c1"],
        reason="",
        history=[event],
    )
    found = object_from_record(record)
    times = found.first_seen, found.history[0].time, found.last_seen
    assert [time and time.timestamp() for time in times] == [1.0, 2.0, 3.0]
    assert (found.history[0].score, found.center_m) == (None, (1.0, None, 0.0))


def test_readiness_names_what_is_missing_and_how_to_start_it():
    everything = {kind: {"x"} for kind, _ in NEEDED}
    assert readiness_from_nodes(1, everything).ready
    assert readiness_from_nodes(0, everything).missing == ["router"]
    for kind, command in NEEDED:
        readiness = readiness_from_nodes(1, everything | {kind: set()})
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
    mission = mission_from_status(status(**facts), 1, True)
    assert (mission.elapsed_s, mission.time_remaining_s) == (elapsed, remaining)


class Row(NamedTuple):
    started_ns: int
    id: str


def sort_key(row):
    return -row.started_ns, row.id


@given(
    st.lists(st.tuples(st.integers(0, 5), st.integers(0, 99)), unique=True, max_size=30), st.integers(1, 7), st.data()
)
def test_pages_by_cursor_have_all_that_was_there_whatever_came_meanwhile(found, limit, data):
    rows = sorted((Row(s, f"m{i}") for s, i in found), key=sort_key)
    got, cursor, first = [], None, True
    while first or cursor:
        page, cursor = page_after(rows, sort_key, cursor, 0, limit)
        assert len(page) <= limit
        got += page
        first = False
        newer = Row(10 + len(rows), f"n{len(rows)}")
        gone = data.draw(st.sampled_from(rows)) if rows and data.draw(st.booleans()) else None
        rows = sorted([newer, *(r for r in rows if r in got or r is not gone)], key=sort_key)
    old = [r for r in rows if r.id.startswith("m")]
    assert len(set(got)) == len(got)
    assert [r for r in got if r in old] == old


@pytest.mark.parametrize("cursor", ["", "x", "1", "1.", "-1.m", "1.m*", "9" * 21 + ".m", "1.m\n"])
def test_what_is_no_cursor_is_refused(cursor):
    with pytest.raises(Problem) as refused:
        page_after([], sort_key, cursor, 0, 10)
    assert refused.value.status == 422
