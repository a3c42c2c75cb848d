"""Poses from sightings of the tag: exact without noise, honest with it, and never led astray by single wrong sightings."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.camera_pose.tag.solve import MIN_STOPS
from surveilnav.camera_pose.tag.start import TagPoses
from surveilnav.errors import PoseError
from surveilnav.geometry import camera_pose
from surveilnav.geometry.lens import BrownConrady, KannalaBrandt
from tests.clicked_points import pose_error
from tests.tag_scenes import LENS, T_WORLD_CAMERA, Scene, random_stops, scene_from_poses, tag_on_robot

BUILDING = {
    "pinhole": T_WORLD_CAMERA,
    "distorted": camera_pose((6.0, 3.0, 2.6), -2.3, -0.5),
    "narrow": camera_pose((0.0, -4.0, 2.4), 0.8, -0.4),
    "fisheye": camera_pose((3.0, 0.0, 2.8), 0.3, -math.pi / 2),
}
LENSES = {
    "pinhole": LENS,
    "distorted": BrownConrady(LENS.pinhole, (-0.3, 0.1, 0.001, -0.001)),
    "narrow": BrownConrady(replace(LENS.pinhole, fx_px=1400.0, fy_px=1400.0)),
    "fisheye": KannalaBrandt(replace(LENS.pinhole, fx_px=400.0, fy_px=400.0), (0.01, -0.005, 0.0, 0.0)),
}


def building(seed: int, n: int = 36) -> Scene:
    rng = np.random.default_rng(seed)
    poses = np.stack([rng.uniform(1, 6, n), rng.uniform(-3, 3, n), rng.uniform(-math.pi, math.pi, n)], axis=1)
    return scene_from_poses(poses, BUILDING, LENSES, tag_on_robot(tilt_rad=0.9))


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    x=st.floats(-0.25, 0.25),
    y=st.floats(-0.25, 0.25),
    height=st.floats(0.1, 1.2),
    tilt=st.floats(-0.1, 1.0),
    yaw=st.floats(-3.1, 3.1),
)
def test_sightings_without_noise_give_the_exact_poses(
    seed: int, x: float, y: float, height: float, tilt: float, yaw: float
) -> None:
    on_robot = tag_on_robot(x, y, height, yaw, tilt)
    poses = random_stops(np.random.default_rng(seed), 12) - [0.0, 0.0, yaw]
    scene = scene_from_poses(poses, T_robot_tag=on_robot, size_m=0.2)
    if scene.sightings.count("lobby") < MIN_STOPS:
        return
    fit = scene.solve()
    assert fit.cameras["lobby"].T_world_camera == pytest.approx(T_WORLD_CAMERA, abs=1e-4)
    assert fit.T_robot_tag == pytest.approx(on_robot, abs=1e-4)
    assert not fit.left_out


def test_cameras_with_different_lenses_are_found_together() -> None:
    scene = building(0)
    fit = scene.solve()
    assert set(fit.cameras) == set(BUILDING)
    for name, camera in fit.cameras.items():
        assert camera.T_world_camera == pytest.approx(BUILDING[name], abs=1e-4)
        assert camera.residual_px < 1e-2
        assert len(camera.stops) == scene.sightings.count(name)


def test_places_far_from_the_origin_change_nothing() -> None:
    T = T_WORLD_CAMERA.copy()
    T[:3, 3] += [4000.0, -700.0, 0.0]
    poses = random_stops(np.random.default_rng(3), 8) + np.array([4000.0, -700.0, 0.0])
    fit = scene_from_poses(poses, {"lobby": T}).solve()
    assert fit.cameras["lobby"].T_world_camera == pytest.approx(T, abs=1e-4)


def test_the_stated_covariance_is_that_of_the_errors() -> None:
    d2 = []
    for seed in range(25):
        rng = np.random.default_rng(seed)
        camera = scene_from_poses(random_stops(rng, 10)).with_errors(rng, sigma_px=0.5).solve().cameras["lobby"]
        error = pose_error(camera.T_world_camera, T_WORLD_CAMERA)
        d2.append(error @ np.linalg.solve(camera.covariance, error))
    assert 0.6 < np.mean(d2) / 6 < 1.5


@pytest.mark.parametrize("wrong", ["place", "direction", "pixels"])
def test_a_wrong_sighting_is_left_out_and_named(wrong: str) -> None:
    rng = np.random.default_rng(5)
    scene = scene_from_poses(random_stops(rng, 10)).with_errors(rng)
    stop = scene.sightings.stops[3]
    if wrong == "place":
        stop.x_m += 1.0
    elif wrong == "direction":
        stop.yaw_rad += 0.5
    else:
        stop.seen["lobby"] += [90.0, 0.0]
    fit = scene.solve()
    assert [(out.camera, out.stop) for out in fit.left_out] == [("lobby", 4)]
    if wrong == "place":
        assert fit.left_out[0].off_m == pytest.approx(1.0, abs=0.35)
    error = pose_error(fit.cameras["lobby"].T_world_camera, T_WORLD_CAMERA)
    assert np.linalg.norm(error[:3]) < 0.1
    assert 4 not in fit.cameras["lobby"].stops


def test_the_mirrored_one_of_two_poses_of_a_sighting_misleads_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """IPPE's order says which pose fits better; whoever relied on it would take these."""
    right = TagPoses.from_sightings

    def mirrored(seen: object) -> TagPoses:
        poses = right(seen)  # type: ignore[arg-type]
        return TagPoses(poses.R_camera_tag[:, ::-1], poses.p_camera[:, ::-1])

    monkeypatch.setattr(TagPoses, "from_sightings", mirrored)
    scene = building(0)
    fit = scene.solve()
    for name, camera in fit.cameras.items():
        assert camera.T_world_camera == pytest.approx(BUILDING[name], abs=1e-4)


def test_a_camera_with_a_wrong_lens_is_named_and_the_others_are_found() -> None:
    scene = building(0)
    wrong = replace(LENS.pinhole, fx_px=2000.0, fy_px=2000.0)
    fit = replace(scene, lenses=LENSES | {"pinhole": BrownConrady(wrong)}).solve()
    assert set(fit.cameras) == {"distorted", "narrow", "fisheye"}
    assert "contradict each other" in fit.refused["pinhole"]
    assert fit.cameras["narrow"].T_world_camera == pytest.approx(BUILDING["narrow"], abs=1e-3)


def test_a_camera_that_saw_the_tag_too_seldom_says_how_often_it_needs() -> None:
    scene = building(0)
    for stop in scene.sightings.stops[:-1]:
        if scene.sightings.count("narrow") > 3:
            stop.seen.pop("narrow", None)
    fit = scene.solve()
    assert fit.refused == {"narrow": "saw the tag at 3 stops: 5 are needed"}


CROWD = np.linspace(0, 1, 8)


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        (np.zeros((0, 3)), "lobby saw the tag at 0 stops: 5 are needed"),
        (np.stack([2 + 4 * CROWD, np.sin(9 * CROWD), math.pi + 0 * CROWD], axis=1), "the robot never turned"),
        (np.stack([3 + 0 * CROWD, 0 * CROWD, math.pi - 0.8 + 1.6 * CROWD], axis=1), "lie within 0.0 m: drive around"),
        (np.stack([2 + 4 * CROWD, 0 * CROWD, math.pi + 0 * CROWD], axis=1), "the robot never turned"),
    ],
    ids=["none", "never turned", "one place", "one line, never turned"],
)
def test_what_is_missing_is_said(poses: np.ndarray, message: str) -> None:
    with pytest.raises(PoseError, match=message):
        scene_from_poses(poses).solve()


def test_a_corridor_is_enough_if_the_robot_turns_in_it() -> None:
    poses = np.stack([2 + 4 * CROWD, 0 * CROWD, math.pi + np.sin(20 * CROWD)], axis=1)
    fit = scene_from_poses(poses).solve()
    assert fit.cameras["lobby"].T_world_camera == pytest.approx(T_WORLD_CAMERA, abs=1e-4)


def test_pixels_outside_the_picture_are_named() -> None:
    scene = scene_from_poses(random_stops(np.random.default_rng(0), 6))
    scene.sightings.stops[2].seen["lobby"] += [3000.0, 0.0]
    with pytest.raises(PoseError, match="at stop 3 outside the picture of 1920 x 1080 pixels"):
        scene.solve()
