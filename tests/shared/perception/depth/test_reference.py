"""The reference depth, against a ray at a time and planes as school mathematics has them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.errors import PerceptionError
from surveilnav.geometry import Matrix4, Pinhole, camera_pose
from surveilnav.perception.depth import reference_depth
from surveilnav.perception.depth.reference import N_CHANNELS, reference_channels

cameras = st.builds(
    Pinhole,
    st.integers(4, 40),
    st.integers(4, 40),
    st.floats(5.0, 60.0),
    st.floats(5.0, 60.0),
    st.floats(0.0, 30.0),
    st.floats(0.0, 30.0),
)


def literal(camera: Pinhole, T_world_camera: Matrix4, floor_z_m: float, column: int, row: int) -> tuple[float, bool]:
    """(depth [m], whether the floor is there) along the ray of one pixel."""
    ray = [(column - camera.cx_px) / camera.fx_px, (row - camera.cy_px) / camera.fy_px, 1.0]
    rise = sum(float(T_world_camera[2, k]) * ray[k] for k in range(3))
    z_m = float(T_world_camera[2, 3])
    ceiling_z_m = max(floor_z_m + 2.6, z_m + 0.3)
    depth_m, on_floor = 10.0, False
    for plane_z_m, is_floor in ((floor_z_m, True), (ceiling_z_m, False)):
        if rise != 0.0 and 0.0 < (at_m := (plane_z_m - z_m) / rise) <= depth_m:
            depth_m, on_floor = at_m, is_floor
    return depth_m, on_floor


@given(
    cameras,
    st.floats(0.5, 4.0),
    st.floats(-3.0, 6.0),
    st.floats(-math.pi, math.pi),
    st.floats(-math.pi / 2, 0.8),
    st.data(),
)
def test_each_pixel_has_the_depth_of_the_nearer_plane(
    camera: Pinhole, height_m: float, floor_z_m: float, yaw: float, pitch: float, data: st.DataObject
) -> None:
    T = camera_pose((1.0, -2.0, floor_z_m + height_m), yaw, pitch)
    column, row = data.draw(st.integers(0, camera.width_px - 1)), data.draw(st.integers(0, camera.height_px - 1))
    reference = reference_depth(camera, T, floor_z_m)
    depth_m, on_floor = literal(camera, T, floor_z_m, column, row)
    assert reference.depth_m[row, column] == pytest.approx(depth_m, rel=1e-3)
    if depth_m < 9.9:
        assert reference.floor[row, column] == on_floor


@given(st.floats(-math.pi / 2, 0.5), st.floats(0.5, 3.0))
def test_points_at_the_floor_depth_lie_on_the_floor(pitch: float, height_m: float) -> None:
    camera, T = Pinhole.from_hfov(32, 24, 1.7), camera_pose((3.0, 4.0, height_m + 1.0), 0.7, pitch)
    reference = reference_depth(camera, T, 1.0)
    p_world = camera.back_project(reference.depth_m).astype(np.float64) @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_allclose(p_world[reference.floor][:, 2], 1.0, atol=1e-4)
    below = np.arcsin(np.clip(reference.elevation[reference.floor], -1, 1)) < 0.0
    assert below.all()


def test_a_camera_that_looks_straight_down_sees_its_height_everywhere() -> None:
    camera = Pinhole.from_hfov(64, 64, math.radians(100))
    reference = reference_depth(camera, camera_pose((0, 0, 1.8), 0.0, -math.pi / 2), 0.0)
    np.testing.assert_allclose(reference.depth_m, 1.8, rtol=1e-5)
    assert reference.floor.all()


def test_channels_are_small_and_have_no_floor_above_the_horizon() -> None:
    camera = Pinhole.from_hfov(128, 96, math.radians(90))
    reference = reference_depth(camera, camera_pose((0, 0, 2.5), 0.0, math.radians(-20)), 0.0)
    channels = reference_channels(reference, camera)
    assert channels.shape == (96, 128, N_CHANNELS)
    assert np.abs(channels).max() < 3.0
    assert (channels[..., 0][reference.elevation >= 0.0] == 0.0).all()


@pytest.mark.parametrize("z_m", [0.9, 1.0, float("nan")])
def test_a_camera_below_its_floor_is_an_error_with_both_heights(z_m: float) -> None:
    with pytest.raises(PerceptionError, match=rf"above its floor.*{z_m:.2f} m.*1\.00 m"):
        reference_depth(Pinhole.from_hfov(8, 8, 1.5), camera_pose((0, 0, z_m), 0.0, -0.5), 1.0)
