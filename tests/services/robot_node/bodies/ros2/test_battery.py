"""What a robot's battery says, and what says nothing."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from surveilnav.services.robot_node.bodies.ros2 import battery
from surveilnav.services.robot_node.bodies.ros2.battery import Battery


@pytest.mark.parametrize(
    ("percentage", "share"),
    [(0.0, 0.0), (0.4, 0.4), (1.0, 1.0), (57.0, 0.57), (100.0, 1.0)]
    + [(nothing, None) for nothing in (math.nan, math.inf, -0.1, 100.5)],
)
def test_only_a_share_or_a_percentage_counts(percentage, share):
    told = Battery()
    assert told.share is None
    told.add(SimpleNamespace(percentage=percentage))
    assert told.share == (pytest.approx(share) if share is not None else None)


def test_a_driver_that_says_percent_once_says_percent_when_it_is_empty():
    told = Battery()
    for percentage in (57.0, 1.0):
        told.add(SimpleNamespace(percentage=percentage))
    assert told.share == pytest.approx(0.01)


def test_what_was_said_long_ago_is_forgotten(monkeypatch):
    told = Battery()
    told.add(SimpleNamespace(percentage=0.5))
    told.add(SimpleNamespace(percentage=math.nan))
    assert told.share == 0.5
    monkeypatch.setattr(battery, "_MAX_AGE_S", -1.0)
    assert told.share is None
