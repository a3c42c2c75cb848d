"""The log of events: who was cut off goes on without a gap, or is told of one."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.services.gateway.core.event_log import EventLog


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
