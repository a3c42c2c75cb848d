"""Logs that a reader resumes from: of events without a gap or with word of one, of states always with the newest."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.services.gateway.core.change_log import _MAX_GONE, EventLog, StateLog


def log_of(n: int, capacity: int = 10) -> EventLog:
    log = EventLog("ab12", capacity)
    for i in range(n):
        log.append("mission", str(i + 1))
    return log


@given(
    st.lists(st.tuples(st.sampled_from(["append", "read", "cut"]), st.integers(1, 5)), max_size=60), st.integers(3, 8)
)
def test_a_reader_gets_every_event_in_order_or_is_told_of_a_gap(script, capacity):
    log = EventLog("e1", capacity)
    last_id, number = log.id_of(0), 0
    got: list[int] = []
    for what, n in script:
        if what == "append":
            for _ in range(n):
                log.append("k", "x")
            continue
        position = log.position(last_id) if what == "cut" else log.checked(number)
        if position.gap:
            assert log.newest - number > capacity  # only where they can't be had
            last_id = log.id_of(position.number)  # a reset has an id, too
            got.append(-1)
        number = position.number
        for event in log.after(number, n):
            assert event.number == number + 1
            number, last_id = event.number, log.id_of(event.number)
            got.append(number)
    everything = list(range(1, number + 1))
    assert -1 in got or got == everything


def test_what_is_kept_is_bounded():
    log = log_of(1000, capacity=7)
    assert [e.number for e in log.after(993)] == [994, 995, 996, 997, 998, 999, 1000]
    assert not log.position("ab12-993").gap
    assert "7 events" in log.position("ab12-992").gap


@pytest.mark.parametrize(
    "last_id", [None, "", "ab12", "ab12-", "ab12-99", "ab12--1", "other-3", "\n", "ab12-3\n", "x" * 99]
)
def test_an_id_that_cant_be_gone_on_from_is_a_gap_at_the_newest(last_id):
    position = log_of(5).position(last_id)
    assert (position.number, bool(position.gap)) == (5, True)


def test_the_newest_id_is_no_gap_and_has_nothing_after_it():
    log = log_of(5)
    assert not log.position("ab12-5").gap
    assert log.after(5) == []
    assert [e.number for e in log.after(3)] == [4, 5]
    assert not EventLog("ab12").position("ab12-0").gap


# --- states -------------------------------------------------------------------------------------------------------

CHANGES = st.lists(
    st.tuples(st.sampled_from(["robot", "camera"]), st.sampled_from("abc"), st.one_of(st.none(), st.integers(0, 3))),
    max_size=40,
)


def read_states(log: StateLog, number: int, shown: dict, limit: int = 2) -> int:
    """Takes in what changed, a few rows at a time; where the reader then is."""
    while rows := log.after(number, limit=limit):
        for row in rows:
            data = json.loads(row.data)
            shown[row.kind, data["id"]] = data["state"]
        number = rows[-1].number
    return number


@given(CHANGES, st.lists(st.integers(0, 40), max_size=4))
def test_whenever_a_reader_looks_it_knows_the_newest_state_of_everything(changes, looks):
    log, truth, shown, number = StateLog("e"), {}, {}, 0
    for at, (kind, id, state) in enumerate(changes):
        told = log.update(kind, id, None if state is None else json.dumps(state))
        assert told == (truth.get((kind, id)) != state)
        if state is not None or (kind, id) in truth:
            truth[kind, id] = state
        if at in looks:
            number = read_states(log, number, shown)
            assert shown == truth
    read_states(log, number, shown)
    assert shown == truth


def test_a_reader_that_comes_back_gets_what_changed_and_a_new_one_gets_all():
    log = StateLog("e")
    log.update("robot", "r1", "1")
    log.update("robot", "r2", "1")
    log.update("robot", "r1", "2")
    assert [r.number for r in log.after(log.position("e-2").number)] == [3]
    for id in (None, "", "e-", "e-99", "other-2", "e-2\n"):
        position = log.position(id)
        assert position.number == 0, id
        assert position.gap, id
    assert [json.loads(r.data) for r in log.after(0)] == [{"id": "r2", "state": 1}, {"id": "r1", "state": 2}]
    assert [json.loads(r.data)["id"] for r in log.after(0, {"r2"})] == ["r2"]


def test_what_is_gone_is_told_and_takes_no_memory_for_ever():
    log = StateLog("e")
    for n in range(_MAX_GONE + 50):
        log.update("object", str(n), "1")
        log.update("object", str(n), None)
    rows = log.after(0, limit=10**6)
    assert len(rows) == _MAX_GONE
    assert all(json.loads(r.data)["state"] is None for r in rows)


def test_an_id_is_a_string_of_json_whatever_is_in_it():
    log = StateLog("e")
    log.update("mission", 'a"\\\n', "{}")
    assert json.loads(log.after(0)[0].data)["id"] == 'a"\\\n'
    assert "\n" not in log.after(0)[0].data
