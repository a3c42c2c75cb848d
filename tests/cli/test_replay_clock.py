"""Which moment of a recording is told: by a table of what people do, and against a clock that ticks."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.cli.replay.clock import ReplayClock


def begun(duration_s: float = 100.0, speed: float = 1.0) -> ReplayClock:
    """A clock that plays from time 50 on."""
    clock = ReplayClock(duration_s, speed)
    clock.set(50.0)
    return clock


def test_it_plays_at_its_speed_to_its_end() -> None:
    clock = begun(speed=4.0)
    assert [clock.at_s(now) for now in (50, 60, 75, 1000)] == [0, 40, 100, 100]
    assert clock.wait_s(60.0, 55.0) == pytest.approx(10.0)
    assert clock.wait_s(10.0, 55.0) == 0.0


@pytest.mark.parametrize(
    ("wanted", "then", "later"),
    [
        ({"playing": False}, 10, 10),
        ({"speed": 2.0}, 10, 30),
        ({"at_s": 80.0}, 80, 90),
        ({"at_s": 3.0, "playing": False}, 3, 3),
        ({"at_s": 1e6}, 100, 100),
        ({"at_s": -5.0}, 0, 10),
        ({}, 10, 20),
    ],
)
def test_what_is_wanted_holds_from_then_on(wanted: dict[str, float], then: float, later: float) -> None:
    clock = begun()
    clock.set(60.0, **wanted)  # type: ignore[arg-type]
    assert (clock.at_s(60.0), clock.at_s(70.0)) == (then, later)


def test_standing_still_nothing_comes_until_it_plays_on() -> None:
    clock = begun()
    clock.set(60.0, playing=False)
    assert clock.wait_s(11.0, 1000.0) == float("inf")
    clock.set(1000.0, playing=True)
    assert clock.wait_s(11.0, 1000.0) == pytest.approx(1.0)


def test_from_its_end_it_plays_from_its_beginning() -> None:
    clock = begun()
    clock.set(500.0, playing=False)
    clock.set(501.0, playing=True)
    assert clock.at_s(503.0) == 2.0
    clock.set(504.0, playing=False, at_s=100.0)
    clock.set(505.0, playing=True, at_s=100.0)  # who says where has it so
    assert clock.at_s(506.0) == 100.0


def test_at_its_end_it_stands_still_until_it_is_told_to_play() -> None:
    clock = begun()
    clock.set(500.0, at_s=20.0)  # taken back, it shows that moment
    assert (clock.playing, clock.at_s(600.0)) == (False, 20.0)
    clock.set(600.0, playing=True)
    assert clock.at_s(605.0) == 25.0
    assert clock.ended(680.0)
    assert not clock.ended(679.0)


def test_played_to_its_end_it_plays_from_its_beginning() -> None:
    clock = begun()
    clock.set(500.0, playing=True)
    assert clock.at_s(503.0) == 3.0


@given(st.lists(st.tuples(st.sampled_from(["play", "pause", "slow", "fast"]), st.integers(1, 20)), max_size=12))
def test_it_is_where_a_clock_that_ticks_is(steps: list[tuple[str, int]]) -> None:
    clock, at, speed, playing, now = ReplayClock(1e9), 0.0, 1.0, True, 7.0
    clock.set(now)
    for what, seconds in steps:
        playing = {"play": True, "pause": False}.get(what, playing)
        speed = {"slow": 0.5, "fast": 8.0}.get(what, speed)
        clock.set(now, speed=speed, playing=playing)
        for _ in range(seconds):
            at += speed * playing
            now += 1.0
        assert clock.at_s(now) == pytest.approx(at)
