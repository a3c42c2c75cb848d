from __future__ import annotations

import math
from pathlib import Path

import pytest

from surveilnav.errors import ConfigError
from surveilnav.simulator.robot_start import start_state
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.simulator.world.goals import find_goals, sample_start


@pytest.fixture(scope="module")
def flat(home_cache: Path) -> SimulatedBuilding:
    with pytest.MonkeyPatch.context() as environ:
        environ.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
        building = SimulatedBuilding(SimulationSettings(building="parametric_flat", lighting="flat"))
        _ = building.navigation
        return building


def test_a_start_is_where_it_is_set_or_free_ground(flat):
    state = start_state(flat, "5,4,0,90", "")
    assert (state.x_m, state.y_m, state.floor, state.yaw_rad) == (5.0, 4.0, "0", pytest.approx(math.pi / 2))
    for start in (start_state(flat, "", ""), start_state(flat, "", "bed")):
        assert flat.navigation.is_navigable(start.p_world, start.floor)
    assert start_state(flat, "", "") == start_state(flat, "", "")


def test_a_start_written_as_a_setting_is_read_as_the_same_place(flat):
    goals = find_goals(flat.scene, flat.navigation, "bed", caster=flat.caster)
    start = sample_start(flat.scene, flat.navigation, goals, seed=3, caster=flat.caster)
    state = start_state(flat, start.setting(), "")
    assert (state.p_world, state.floor, state.yaw_rad) == (start.p_m, start.floor, pytest.approx(start.yaw_rad))


@pytest.mark.parametrize(
    ("start", "says"),
    [("5,4,0", "a start is x,y,floor,yaw_deg"), ("5,4,9,0", "no floor '9'"), ("-9,4,0,0", "can't stand at -9,4")],
)
def test_a_start_that_cannot_be_says_what_can(flat, start, says):
    with pytest.raises(ConfigError, match=says):
        start_state(flat, start, "")
