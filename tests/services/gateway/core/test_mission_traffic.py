"""What missions cost: sums that only grow, missions that come and go."""

from __future__ import annotations

import pytest

from surveilnav.messages import MissionStatus
from surveilnav.rest import LinkTraffic
from surveilnav.services.gateway.core.mission_traffic import _MAX_MISSIONS, ByteCounts, MissionUsages


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
    usages = MissionUsages()
    usages.update([], ByteCounts(1000, 900, 1100))
    usages.update([status(state="queued")], ByteCounts(2000, 1800, 2200))
    assert usages.get("m") is None
    usages.update([status(step=0)], ByteCounts(2500, 2200, 2600))
    usages.update([status(step=1)], ByteCounts(3500, 3100, 3700))
    usages.update([status(step=1, state="done")], ByteCounts(9000, 9000, 9000))
    usage = usages.get("m")
    assert usage.spent == ByteCounts(1500, 1300, 1500)
    assert usage.whole
    assert usage.alone


def test_what_goes_over_each_link_meanwhile_is_the_missions_too():
    usages = MissionUsages()
    for links in ((10, 10, 10, 10), (110, 20, 10, 10), (115, 20, 3, 10)):  # a server was started again
        usages.update([status(step=1)], ByteCounts(links=links))
    cost = usages.get("m").resource(status(step=1), 1)
    assert cost.links == LinkTraffic(camera_bytes=105, robot_bytes=10, server_bytes=0, simulation_bytes=0)


def test_a_process_that_starts_anew_counts_for_nothing_less():
    usages = MissionUsages()
    for total in (5000, 6000, 100, 400):
        usages.update([status()], ByteCounts(total, total, total))
    assert usages.get("m").spent.offered == 1000 + 0 + 300


def test_the_forecast_is_by_the_newest_steps_and_ends_with_the_mission():
    usages = MissionUsages()
    total = 0
    for step in range(60):
        total += 1_000_000 if step < 30 else 1000  # cameras send all their views at first
        usages.update([status(step=step)], ByteCounts(total, total, total))
        assert (usages.get("m").per_step is None) == (step < 20)
    usage = usages.get("m")
    assert usage.per_step == pytest.approx(1000)
    assert usage.at_most(status(step=59)) == pytest.approx(usage.spent.offered + 41 * 1000)
    assert usage.at_most(status(step=59, state="done")) is None
    assert usage.at_most(status(step=59, max_steps=0)) is None


def test_two_at_a_time_arent_told_apart_and_say_so():
    usages = MissionUsages()
    usages.update([status("a"), status("b")], ByteCounts())
    usages.update([status("a"), status("b")], ByteCounts(100, 0, 0))
    usages.update([status("a")], ByteCounts(150, 0, 0))
    assert (usages.get("a").spent.offered, usages.get("b").spent.offered) == (150, 100)
    assert not usages.get("a").alone
    assert not usages.get("b").alone


def test_who_comes_later_than_the_mission_says_so():
    usages = MissionUsages()
    usages.update([status(step=40)], ByteCounts(10**9, 0, 0))
    assert not usages.get("m").whole
    assert usages.get("m").spent == ByteCounts()
    assert usages.get("m").per_step is None


def test_missions_without_end_take_no_memory_without_end():
    usages = MissionUsages()
    for n in range(_MAX_MISSIONS + 10):
        usages.update([status(str(n))], ByteCounts())
    assert usages.get("5") is None
    assert usages.get(str(_MAX_MISSIONS + 9)) is not None
