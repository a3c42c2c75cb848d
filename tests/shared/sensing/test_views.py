from __future__ import annotations

import math

import pytest

from surveilnav.geometry import camera_pose
from surveilnav.sensing.views import looks_straight_down


@pytest.mark.parametrize(("pitch_deg", "nadir"), [(-90, True), (-76, True), (-74, False), (-30, False), (89, False)])
def test_a_view_from_straight_above_is_known_by_its_pose(pitch_deg, nadir):
    for yaw_rad in (0.0, 2.0):
        assert looks_straight_down(camera_pose((1.0, 2.0, 3.0), yaw_rad, math.radians(pitch_deg))) == nadir
