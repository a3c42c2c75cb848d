"""What a building's network will need."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import pytest

from surveilnav.errors import ConfigError
from surveilnav.messages import Tier
from surveilnav.traffic_forecast import Plan, TrafficCosts, forecast, measured_costs

SURE = TrafficCosts(
    view_bytes=dict.fromkeys(get_args(Tier), (1000.0, 0.0)),
    building_share=0.0,
    robot_step_bytes=(50.0, 0.0),
    server_step_bytes=(20.0, 0.0),
    steps=(100.0, 1e-6),
    step_s=0.5,
    idle_bytes_s={"camera": 2.0, "robot": 3.0, "server": 4.0},
)
PLAN = Plan(cameras=10, views=4, tier="features", missions_per_hour=6.0, cameras_per_mission=5, robots=2)


def test_without_chance_it_is_a_sum():
    """Five cameras with four views of 1 kB; 100 steps of 50 and 20 B; an hour of waiting. Only the number of missions varies."""
    need = forecast(PLAN, SURE)
    assert need["camera"].mission_bytes == pytest.approx(20_000)
    assert need["robot"].mission_bytes == pytest.approx(5000, rel=1e-4)
    assert need["server"].mission_bytes == pytest.approx(2000, rel=1e-4)
    idle = {"camera": 72_000, "robot": 21_600, "server": 14_400}
    for link, n_bytes in idle.items():
        of_missions = need[link].hour_bytes - n_bytes
        assert of_missions == pytest.approx(6 * need[link].mission_bytes, rel=0.02)
    # nine of ten hours with six missions on average have 2 to 10 (Poisson)
    assert need["camera"].hour_low_bytes == pytest.approx(72_000 + 2 * 20_000)
    assert need["camera"].hour_high_bytes == pytest.approx(72_000 + 10 * 20_000)


def test_moving_pictures_come_again():
    """100 steps of 0.5 s, twice a second: each view is sent 101 times."""
    need = forecast(replace(PLAN, hz=2.0), SURE)
    assert need["camera"].mission_bytes == pytest.approx(101 * 20_000, rel=1e-3)


def test_all_cameras_take_part_if_nobody_says_how_many():
    assert forecast(replace(PLAN, cameras_per_mission=0), SURE)["camera"].mission_bytes == pytest.approx(40_000)


def test_without_missions_there_is_waiting_alone():
    need = forecast(replace(PLAN, missions_per_hour=0.0), SURE)
    assert (need["camera"].mission_bytes, need["camera"].hour_bytes) == (0.0, 72_000)


def test_the_costs_of_the_program_have_every_tier():
    costs = measured_costs()
    by_tier = [forecast(replace(PLAN, tier=tier), costs)["camera"].mission_bytes for tier in get_args(Tier)]
    assert len(set(by_tier)) == len(by_tier)
    assert forecast(replace(PLAN, tier="auto"), costs) == forecast(PLAN, costs), "auto sends features"
    need = forecast(PLAN, costs)["camera"]
    assert need.hour_low_bytes < need.hour_bytes < need.hour_high_bytes


@pytest.mark.parametrize(
    "changes",
    [
        {"cameras": 0},
        {"cameras": -3},
        {"views": 0},
        {"robots": -1},
        {"cameras_per_mission": 11},
        {"missions_per_hour": -1.0},
        {"missions_per_hour": float("nan")},
        {"hz": float("inf")},
    ],
)
def test_numbers_that_no_building_has_are_refused(changes):
    with pytest.raises(ConfigError):
        forecast(replace(PLAN, **changes), SURE)
