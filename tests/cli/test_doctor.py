"""``surveilnav doctor --building``: how much of it robots can reach."""

from __future__ import annotations

import surveilnav.cli.doctor
from surveilnav.cli.doctor import examine
from surveilnav.simulator.world.reach import FloorReach, Reach


def finding(name):
    return next(f for f in examine(name) if f.what == "building")


def test_it_says_what_robots_reach_of_a_building():
    found = finding("parametric_house")
    assert (found.level, found.detail[:35]) == ("ok", "parametric_house: robots reach all ")
    assert finding("no_such_home").level == "problem"
    assert all(f.what != "building" for f in examine())


def test_it_says_what_they_cant_reach(monkeypatch):
    class Building:
        def __init__(self, settings, progress):
            self.reach = Reach((FloorReach("0", "", 9.0, 4.0),), ("no stair leads to level 1",))

    monkeypatch.setattr(surveilnav.cli.doctor, "SimulatedBuilding", Building)
    found = finding("house.sh3d")
    assert (found.level, found.detail) == ("note", "house.sh3d: robots reach 4 of 9 m²: no stair leads to level 1")
