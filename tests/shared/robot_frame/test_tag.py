"""A robot's frame from its tag in cameras whose poses are known: exact without errors, honest with them, wrong stops named."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.camera_pose.tag.detection import TagDetector
from surveilnav.camera_pose.tag.sightings import Sightings
from surveilnav.errors import FrameError
from surveilnav.geometry import base_pose, camera_pose, inverse
from surveilnav.robot_frame import PlanarTransform
from surveilnav.robot_frame.tag import from_tag
from tests.tag_scenes import LENS, T_WORLD_CAMERA, random_stops, render_tag, scene_from_poses, tag_on_robot

FRAME = PlanarTransform(12.4, -3.1, math.radians(91.5))
CAMERAS = {"lobby": T_WORLD_CAMERA, "desk": camera_pose((6.0, 3.0, 2.6), -2.3, -0.5)}


def in_map(scene, T_building_map):
    """The scene as a robot reports it whose map lies there."""
    stops = []
    for stop in scene.sightings.stops:
        x, y = T_building_map.inverse().apply((stop.x_m, stop.y_m))
        stops.append(replace(stop, x_m=float(x), y_m=float(y), yaw_rad=stop.yaw_rad - T_building_map.yaw_rad))
    return replace(scene, sightings=Sightings(scene.sightings.tag, stops))


def around(seed, n=24, **tag):
    rng = np.random.default_rng(seed)
    poses = np.stack([rng.uniform(1, 5.5, n), rng.uniform(-2, 2, n), rng.uniform(-math.pi, math.pi, n)], axis=1)
    return in_map(scene_from_poses(poses, CAMERAS, T_robot_tag=tag_on_robot(**tag)), FRAME)


def found(scene, **options):
    return from_tag(scene.sightings, scene.lenses, scene.T_world_camera, {"ground": 0.0}, **options)


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    frame=st.tuples(st.floats(-30, 30), st.floats(-30, 30), st.floats(-3.1, 3.1)),
    tag=st.tuples(st.floats(-0.25, 0.25), st.floats(-0.25, 0.25), st.floats(0.1, 1.2), st.floats(-3.1, 3.1)),
)
def test_sightings_without_errors_give_the_exact_frame(seed, frame, tag):
    x, y, height, yaw = tag
    T = PlanarTransform(*frame)
    stops = random_stops(np.random.default_rng(seed), 10) - [0.0, 0.0, yaw]
    scene = in_map(scene_from_poses(stops, T_robot_tag=tag_on_robot(x, y, height, yaw)), T)
    if sum(bool(stop.seen) for stop in scene.sightings.stops) < 6:
        return
    result = found(scene)
    off_m, off_rad = result.T_building_map.difference(T, T.inverse().apply((3.0, 0.0)))
    assert off_m < 1e-3
    assert off_rad < 1e-3
    assert result.residual_m < 1e-3
    assert result.left_out == ()


def test_with_errors_it_is_right_within_what_it_says():
    off = []
    for seed in range(12):
        scene = around(seed).with_errors(np.random.default_rng(seed), sigma_m=0.03, sigma_rad=math.radians(1.5))
        result = found(scene)
        off.append(result.T_building_map.difference(FRAME, FRAME.inverse().apply((3.0, 0.0))))
        assert result.residual_m < 0.15
        assert result.method == "tag"
    assert np.median([m for m, _ in off]) < 0.025
    assert max(m for m, _ in off) < 0.06
    assert max(rad for _, rad in off) < math.radians(1.5)


def test_wrong_stops_are_left_out_and_named():
    scene = around(1).with_errors(np.random.default_rng(1))
    seen = [k for k, stop in enumerate(scene.sightings.stops) if stop.seen]
    wrong = seen[1], seen[4]
    stops = list(scene.sightings.stops)
    for k in wrong:  # its localisation was off
        stops[k] = replace(stops[k], x_m=stops[k].x_m + 0.8, yaw_rad=stops[k].yaw_rad + 0.3)
    result = found(replace(scene, sightings=Sightings(scene.sightings.tag, stops)))
    assert set(result.left_out) == {k + 1 for k in wrong}
    assert "contradict the others" in result.sentence
    assert result.T_building_map.difference(FRAME, FRAME.inverse().apply((3.0, 0.0)))[0] < 0.06


def test_a_camera_whose_pose_is_wrong_is_named():
    scene = around(2, n=40).with_errors(np.random.default_rng(2))
    n = {name: scene.sightings.count(name) for name in CAMERAS}
    bad = min(n, key=n.__getitem__)
    T = scene.T_world_camera[bad].copy()
    T[:3, 3] += (0.7, 0.5, 0.0)
    result = found(replace(scene, T_world_camera={**scene.T_world_camera, bad: T}))
    assert f"sightings by camera {bad} contradict the others: its pose may be wrong" in result.sentence
    assert result.T_building_map.difference(FRAME, FRAME.inverse().apply((3.0, 0.0)))[0] < 0.08


def test_two_cameras_that_contradict_each_other_are_told():
    scene = around(0, n=40).with_errors(np.random.default_rng(0))
    T = T_WORLD_CAMERA.copy()
    T[:3, 3] += (0.7, 0.5, 0.0)
    with pytest.raises(FrameError, match=r"0 of \d+ by (desk|lobby)") as error:
        found(replace(scene, T_world_camera={**scene.T_world_camera, "lobby": T}))
    assert error.value.name == "contradictory"


@pytest.mark.parametrize(
    ("change", "name", "said"),
    [
        (
            lambda scene: replace(scene, sightings=Sightings(scene.sightings.tag, scene.sightings.stops[:3])),
            "undetermined",
            "are needed",
        ),
        (lambda scene: replace(scene, T_world_camera={}), "undetermined", "at 0 stops"),
        (lambda scene: scrambled(scene), "contradictory", "agree on where"),
    ],
)
def test_what_is_missing_is_said(change, name, said):
    with pytest.raises(FrameError, match=said) as error:
        found(change(around(3)))
    assert error.value.name == name


def scrambled(scene):
    """Each stop's place is that of another: the robot has no idea where it is."""
    rng = np.random.default_rng(0)
    stops = [
        replace(stop, x_m=rng.uniform(-9, 9), y_m=rng.uniform(-9, 9), yaw_rad=rng.uniform(-3, 3))
        for stop in scene.sightings.stops
    ]
    return replace(scene, sightings=Sightings(scene.sightings.tag, stops))


def test_all_stops_at_one_place_and_in_one_direction_are_refused():
    poses = np.tile([[3.0, 0.2, math.pi]], (6, 1)) + np.random.default_rng(0).normal(0, 0.01, (6, 3))
    with pytest.raises(FrameError, match="several directions") as error:
        found(in_map(scene_from_poses(poses, CAMERAS), FRAME))
    assert error.value.name == "undetermined"


def test_from_rendered_pictures():
    """Through the detector, from pictures of 1920 x 1080 pixels."""
    on_robot, detector = tag_on_robot(), TagDetector(0)
    stops = random_stops(np.random.default_rng(5), 8, reach_m=(1.5, 4.0))
    scene = scene_from_poses(stops)
    for stop in scene.sightings.stops:
        T_camera_tag = inverse(T_WORLD_CAMERA) @ base_pose((stop.x_m, stop.y_m, 0.0), stop.yaw_rad) @ on_robot
        corners = detector.corners(render_tag(LENS, T_camera_tag, 0.16))
        stop.seen = {} if corners is None else {"lobby": corners}
    result = found(in_map(scene, FRAME))
    off_m, off_rad = result.T_building_map.difference(FRAME, FRAME.inverse().apply((3.0, 0.0)))
    assert off_m < 0.02
    assert off_rad < math.radians(0.5)
