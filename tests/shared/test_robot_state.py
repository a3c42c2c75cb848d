from __future__ import annotations

import math

import numpy as np
import pytest

from surveilnav.geometry import yaw_of
from surveilnav.robot_body import CAMERA
from surveilnav.robot_state import RobotState


def test_a_new_mission_begins_where_the_last_one_ended() -> None:
    ended = RobotState(2.25, 3.0, 0.0, "0", 0.0, seq=2, steps=2, path_m=0.25, stopped=True, last_action="stop")
    begun = ended.begin_mission("m2")
    assert (begun.p_world, begun.seq, begun.mission) == (ended.p_world, 2, "m2")
    assert (begun.path_m, begun.steps, begun.stopped, begun.last_action) == (0.0, 0, False, None)


def test_poses() -> None:
    state = RobotState(1.0, 2.0, 0.5, "0", math.radians(90), math.radians(-30))
    assert np.allclose(state.base_pose()[:3, 3], (1.0, 2.0, 0.5))
    assert yaw_of(state.base_pose()) == pytest.approx(math.radians(90))
    T = state.camera_pose()
    assert np.allclose(T[:3, 3], (1.0, 2.0, 1.38))
    assert np.allclose(T[:3, 2], (0.0, math.cos(math.radians(30)), -0.5))
    assert (CAMERA.width_px, CAMERA.height_px) == (640, 480)
    assert math.degrees(CAMERA.hfov_rad) == pytest.approx(79.0)
