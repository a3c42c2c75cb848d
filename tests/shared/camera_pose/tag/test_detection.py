"""The tag in rendered pictures, and from there to the camera's pose."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from surveilnav.camera_pose.tag.detection import TagDetector, tag_corners, tag_picture
from surveilnav.geometry import base_pose, inverse, transform_points
from surveilnav.geometry.lens import BrownConrady, KannalaBrandt, Lens
from tests.tag_scenes import LENS, T_WORLD_CAMERA, random_stops, render_tag, scene_from_poses, tag_on_robot

LENSES = {
    "pinhole": LENS,
    "distorted": BrownConrady(LENS.pinhole, (-0.3, 0.1, 0.001, -0.001)),
    "fisheye": KannalaBrandt(replace(LENS.pinhole, fx_px=700.0, fy_px=700.0), (0.01, -0.005, 0.0, 0.0)),
}


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
@pytest.mark.parametrize("ahead_m", [2.0, 4.0, 6.0])
def test_corners_are_found_to_half_a_pixel(lens: Lens, ahead_m: float) -> None:
    T_world_tag = base_pose((ahead_m, 0.6, 0.0), math.pi + 0.4) @ tag_on_robot()
    T_camera_tag = inverse(T_WORLD_CAMERA) @ T_world_tag
    found = TagDetector(0).corners(render_tag(lens, T_camera_tag, 0.3))
    assert found is not None
    expected = lens.pixels(transform_points(T_camera_tag, tag_corners(0.3)))
    assert np.abs(found - expected).max() < 0.6


def test_a_tag_of_another_number_and_two_of_the_same_are_none() -> None:
    one = tag_picture(3, module_px=8)
    both = np.repeat(np.hstack([one, one])[..., None], 3, axis=-1)
    single = np.repeat(one[..., None], 3, axis=-1)
    assert TagDetector(3).corners(single) is not None
    assert TagDetector(4).corners(single) is None
    assert TagDetector(3).corners(both) is None
    with pytest.raises(ValueError, match="tags 0 to 586"):
        TagDetector(587)


def test_a_mirror_image_is_none() -> None:
    picture = np.repeat(tag_picture(0, module_px=8)[..., None], 3, axis=-1)
    assert TagDetector(0).corners(np.ascontiguousarray(picture[:, ::-1])) is None


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
def test_rendered_pictures_give_the_pose(lens: Lens) -> None:
    """Seen through a warped picture with a sensor's noise: all of it, without the truth in between."""
    rng = np.random.default_rng(2)
    scene = scene_from_poses(random_stops(rng, 9), lenses={"lobby": lens}, size_m=0.3)
    for stop in scene.sightings.stops:
        stop.seen.clear()
        T_world_tag = base_pose((stop.x_m, stop.y_m, 0.0), stop.yaw_rad) @ scene.T_robot_tag
        picture = cv2.GaussianBlur(render_tag(lens, inverse(T_WORLD_CAMERA) @ T_world_tag, 0.3), (0, 0), 0.7)
        noisy = np.clip(picture + rng.normal(0, 4, picture.shape), 0, 255).astype(np.uint8)
        if (corners := TagDetector(0).corners(noisy)) is not None:
            stop.seen["lobby"] = corners
    camera = scene.solve().cameras["lobby"]
    assert len(camera.stops) >= 7
    assert camera.residual_px < 0.8
    assert camera.T_world_camera == pytest.approx(T_WORLD_CAMERA, abs=0.03)
