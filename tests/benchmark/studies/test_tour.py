"""A robot's tour of a building."""

from __future__ import annotations

import itertools
import math

from surveilnav.benchmark.studies.calibration.tour import LOOK_DOWN_RAD, Tour, states_of
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.world.navigation import NavigationMap


def test_the_tour_stays_on_free_ground_on_every_floor_and_within_its_budget():
    navigation = NavigationMap.build(open_building("parametric_house", seed=0))
    tour = Tour(240, math.radians(30), 0.25)
    states = states_of(navigation, tour)
    assert states == states_of(navigation, tour)
    assert 120 <= len(states) <= 240
    assert [s.seq for s in states] == list(range(1, len(states) + 1))
    assert {s.floor for s in states} == {name for name, area in navigation.robot_area.items() if area.any()}
    assert all(navigation.is_navigable(s.p_world, s.floor) for s in states)
    assert {s.pitch_rad for s in states} == {0.0, LOOK_DOWN_RAD}
    for a, b in itertools.pairwise(states):  # as a robot moves: it turns, or goes, never far
        if a.floor == b.floor and a.yaw_rad == b.yaw_rad:
            assert math.dist(a.p_world, b.p_world) <= tour.step_m + 1e-9
