"""What missions cost: sums that only grow, missions that come and go."""

from __future__ import annotations

import pytest

from surveilnav.messages import MissionStatus
from surveilnav.services.gateway.core.costs import _MOST_MISSIONS, Costs, Sums


def status(mission: str = "m", step: int = 0, state: str = "active", max_steps: int = 100) -> MissionStatus:
    return MissionStatus(
        stamp_ns=1,
        mission=mission,
        target="tv",
        robot="r",
        state=state,
        phase="",
        step=step,
        max_steps=max_steps,
        path_m=0.0,
        started_ns=1,
    )


def test_only_what_is_sent_while_it_runs_counts():
    costs = Costs()
    costs.look([], Sums(1000, 900, 1100))
    costs.look([status(state="queued")], Sums(2000, 1800, 2200))
    assert costs.get("m") is None
    costs.look([status(step=0)], Sums(2500, 2200, 2600))
    costs.look([status(step=1)], Sums(3500, 3100, 3700))
    costs.look([status(step=1, state="done")], Sums(9000, 9000, 9000))
    cost = costs.get("m")
    assert cost.spent == Sums(1500, 1300, 1500)
    assert cost.whole
    assert cost.alone


def test_a_process_that_starts_anew_counts_for_nothing_less():
    costs = Costs()
    for total in (5000, 6000, 100, 400):
        costs.look([status()], Sums(total, total, total))
    assert costs.get("m").spent.offered == 1000 + 0 + 300


def test_the_forecast_is_by_the_newest_steps_and_ends_with_the_mission():
    costs = Costs()
    total = 0
    for step in range(60):
        total += 1_000_000 if step < 30 else 1000  # cameras send all their views at first
        costs.look([status(step=step)], Sums(total, total, total))
        assert (costs.get("m").per_step is None) == (step < 20)
    cost = costs.get("m")
    assert cost.per_step == pytest.approx(1000)
    assert cost.at_most(status(step=59)) == pytest.approx(cost.spent.offered + 41 * 1000)
    assert cost.at_most(status(step=59, state="done")) is None
    assert cost.at_most(status(step=59, max_steps=0)) is None


def test_two_at_a_time_arent_told_apart_and_say_so():
    costs = Costs()
    costs.look([status("a"), status("b")], Sums())
    costs.look([status("a"), status("b")], Sums(100, 0, 0))
    costs.look([status("a")], Sums(150, 0, 0))
    assert (costs.get("a").spent.offered, costs.get("b").spent.offered) == (150, 100)
    assert not costs.get("a").alone
    assert not costs.get("b").alone


def test_who_comes_later_than_the_mission_says_so():
    costs = Costs()
    costs.look([status(step=40)], Sums(10**9, 0, 0))
    assert not costs.get("m").whole
    assert costs.get("m").spent == Sums()
    assert costs.get("m").per_step is None


def test_missions_without_end_take_no_memory_without_end():
    costs = Costs()
    for n in range(_MOST_MISSIONS + 10):
        costs.look([status(str(n))], Sums())
    assert costs.get("5") is None
    assert costs.get(str(_MOST_MISSIONS + 9)) is not None
