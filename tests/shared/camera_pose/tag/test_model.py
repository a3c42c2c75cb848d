"""What cameras, tag and stops predict, and its derivatives."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from surveilnav.camera_pose.tag.adjustment import nullity, singular_values
from surveilnav.camera_pose.tag.model import State, linearise
from surveilnav.geometry import camera_pose
from surveilnav.geometry.lens import BrownConrady, KannalaBrandt
from tests.tag_scenes import LENS, T_WORLD_CAMERA, exactly, random_stops, scene_from_poses, tag_on_robot

CAMERAS = {
    "pinhole": T_WORLD_CAMERA,
    "distorted": camera_pose((0.3, 1.0, 2.6), -0.2, -0.5),
    "fisheye": camera_pose((3.0, 0.0, 2.8), 0.3, -math.pi / 2),
}
LENSES = {
    "pinhole": LENS,
    "distorted": BrownConrady(LENS.pinhole, (-0.3, 0.1, 0.001, -0.001)),
    "fisheye": KannalaBrandt(replace(LENS.pinhole, fx_px=400.0, fy_px=400.0), (0.01, -0.005, 0.0, 0.0)),
}


def test_the_truth_has_no_residuals_and_derivatives_are_those_of_differences() -> None:
    state, seen = exactly(scene_from_poses(random_stops(np.random.default_rng(1), 6), CAMERAS, LENSES))
    assert set(seen.camera) == {0, 1, 2}
    at = linearise(state, seen)
    assert at.residuals == pytest.approx(0, abs=1e-6)
    n = 6 * 3 + 5 + 3 * len(seen.stops)
    for unknown in range(n):
        step = 1e-6 * np.eye(n)[unknown]
        ahead, behind = (linearise(state.moved(s * step), seen).residuals for s in (1, -1))
        expected = -(ahead - behind) / 2e-6
        found = np.zeros_like(expected)
        if unknown < 18:
            own = seen.camera == unknown // 6
            found[own] = at.by_camera[own, :, unknown % 6]
        elif unknown < 23:
            found = at.by_tag[..., unknown - 18]
        else:
            own = seen.stop == (unknown - 23) // 3
            found[own] = at.by_stop[own, :, (unknown - 23) % 3]
        assert found == pytest.approx(expected, rel=1e-4, abs=0.05)


def test_a_higher_tag_and_higher_cameras_look_the_same() -> None:
    state, seen = exactly(scene_from_poses(random_stops(np.random.default_rng(1), 6), CAMERAS, LENSES))
    cameras, tag = state.T_world_camera.copy(), state.T_robot_tag.copy()
    cameras[:, 2, 3] += 0.4
    tag[2, 3] += 0.4
    assert linearise(State(cameras, tag, state.stops), seen).residuals == pytest.approx(0, abs=1e-6)


X, Y = [2.0, 3.0, 4.0, 5.0, 2.5, 3.5], [0.5, -0.6, 0.2, -0.3, 0.4, -0.1]
TURN = [0.0, 0.5, -0.6, 0.3, -0.2, 0.6]
NONE = [0.0] * 6


@pytest.mark.parametrize(
    ("x", "y", "turn", "open_combinations"),
    [
        (X, Y, TURN, 0),
        (X, NONE, TURN, 0),  # a corridor
        (X, Y, NONE, 2),  # the tag shifted on the robot, and the camera the other way
        ([3.0] * 6, NONE, TURN, 1),  # all turned about the place
        (X, NONE, NONE, 3),  # a corridor without a turn: besides the shift, all turned about it
        ([3.0] * 6, NONE, NONE, 5),
    ],
    ids=["spread", "line", "never turned", "one place", "line, never turned", "one pose"],
)
def test_what_planar_motion_leaves_open(
    x: list[float], y: list[float], turn: list[float], open_combinations: int
) -> None:
    """The numbers in the docstring of geometry_of_stops."""
    poses = np.stack([x, y, math.pi + np.array(turn)], axis=1)
    state, seen = exactly(scene_from_poses(poses, T_robot_tag=tag_on_robot(tilt_rad=0.5)))
    assert len(seen) == 6
    assert nullity(singular_values(state, seen)[0]) == open_combinations
