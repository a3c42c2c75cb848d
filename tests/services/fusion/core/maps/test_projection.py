"""Back-projection and azimuth_ranges."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.geometry import camera_pose, inverse, transform_points
from surveilnav.services.fusion.core.maps.projection import (
    AZIMUTHS,
    azimuth_bins,
    azimuth_ranges,
    covered_box,
    sample_stride,
    world_points,
)


@given(yaw=st.floats(-3.1, 3.1), pitch=st.floats(-0.7, 0.2), x=st.floats(1, 5), y=st.floats(1, 3))
def test_points_lie_on_the_planes_they_came_from(tools, yaw, pitch, x, y):
    room = tools.world()
    points, _ = world_points(room.view(x, y, yaw, pitch), 4000, 20.0, edge=10.0)
    low, high = np.array(room.room)
    assert len(points) > 1000
    assert np.minimum(abs(points - low), abs(points - high)).min(axis=1).max() < 1e-4


def test_subsampled_points_are_those_of_their_pixels(world):
    view = world.view(2, 2, 0.3, -0.2)
    stride = sample_stride(160, 120, 1000)
    T, camera = view.T_world_camera, view.camera
    expected = []
    for v in range(stride // 2, 120, stride):
        for u in range(stride // 2, 160, stride):
            d = view.depth_m[v, u]
            p = np.array([(u - camera.cx_px) / camera.fx_px * d, (v - camera.cy_px) / camera.fy_px * d, d])
            expected.append(T[:3, :3] @ p + T[:3, 3])
    points, colours = world_points(view, 1000, 20.0, edge=10.0)
    np.testing.assert_allclose(points, expected, atol=1e-5)
    assert colours.shape == points.shape


@given(
    yaw=st.floats(-3.1, 3.1),
    pitch=st.floats(-1.5, 1.5),
    x=st.floats(-50, 50),
    y=st.floats(-50, 50),
    u=st.integers(0, 159),
    v=st.integers(0, 119),
    depth_m=st.floats(0.2, 9.5),
)
def test_pixel_to_point_to_pixel(tools, yaw, pitch, x, y, u, v, depth_m):
    """p_global = R p + t and back: the point of a pixel falls on that pixel, at that depth, in its colour."""
    view = tools.world().view(1, 1, 0)
    view = replace(view, T_world_camera=camera_pose((x, y, 1.0), yaw, pitch))
    view.depth_m[:] = 0.0
    view.depth_m[v, u] = depth_m
    view.rgb[v, u] = (1, 2, 3)
    points, colours = world_points(view, 160 * 120, 20.0, edge=1e9)
    assert colours.tolist() == [[1, 2, 3]]
    p_camera = transform_points(inverse(view.T_world_camera), points.astype(np.float64))
    np.testing.assert_allclose(view.camera.project(p_camera), [[u, v]], atol=0.01)
    assert p_camera[0, 2] == pytest.approx(depth_m, abs=2e-5)
    again = transform_points(view.T_world_camera, view.camera.rays()[v, u][None].astype(np.float64) * p_camera[0, 2])
    np.testing.assert_allclose(again, points, atol=5e-5)


@pytest.mark.parametrize("bad", [np.nan, 0.0, -1.0, np.inf, 0.05, 5.0, 5.5])
def test_depth_that_is_none_is_dropped(world, bad):
    view = world.view(2, 2, 0.0)
    depth_m = np.full_like(view.depth_m, 2.0)
    depth_m[:60] = bad
    view = replace(view, depth_m=depth_m)
    points, _ = world_points(view, 160 * 120, 5.0, edge=0.5)
    assert len(points) == 60 * 160


def test_a_flying_pixel_is_dropped_and_an_edge_is_not(world):
    view = world.view(2, 2, 0.0)
    depth_m = np.full_like(view.depth_m, 2.0)
    depth_m[:, 80:] = 4.0
    whole, _ = world_points(replace(view, depth_m=depth_m), 160 * 120, 9.0, edge=0.05)
    depth_m[50, 80] = 3.0  # between the near and the far surface
    without, _ = world_points(replace(view, depth_m=depth_m), 160 * 120, 9.0, edge=0.05)
    assert len(whole) == 160 * 120
    assert len(without) == len(whole) - 1


def test_reach_is_where_rays_run_below_the_ceiling():
    camera = np.array([0.0, 0.0, 2.0])
    points = np.array([[4.0, 0.01, 0.0], [3.0, 0.02, 1.5], [0.01, 2.0, 0.5]], np.float32)
    found = azimuth_ranges(points, camera, 1.0)
    np.testing.assert_allclose(found[0], [2.0, 4.0], rtol=1e-3)  # comes below 1 m half-way; the high point adds nothing
    np.testing.assert_allclose(found[89], [4 / 3, 2.0], rtol=1e-3)
    low = azimuth_ranges(np.array([[4.0, 0.01, 2.5]], np.float32), np.array([0.0, 0.0, 0.5]), 1.0)
    np.testing.assert_allclose(low[0], [0.0, 1.0], rtol=1e-3)  # leaves the band a quarter of the way up


def test_a_gap_of_one_degree_is_bridged_by_what_both_sides_agree_on():
    at = [math.radians(d) for d in (10.5, 12.5, 20.5)]
    points = np.array([[r * math.cos(a), r * math.sin(a), 0.5] for a, r in zip(at, (3, 2, 3), strict=True)], np.float32)
    found = azimuth_ranges(points, np.zeros(3), 1.0)
    assert found[11, 1] == pytest.approx(2.0)
    assert found[13:20].max() == 0.0


def test_azimuth_bins_cover_what_a_literal_test_of_each_cell_covers():
    rng = np.random.default_rng(1)
    ranges = np.sort(rng.uniform(0, 3, (AZIMUTHS, 2)), axis=1).astype(np.float32)
    ranges[rng.random(AZIMUTHS) < 0.3] = 0
    found = azimuth_bins(ranges, 0.12, -0.33, 0.1, -30, -25, 50, 60)
    for row in range(50):
        for col in range(60):
            x, y = (col - 25 + 0.5) * 0.1 - 0.12, (row - 30 + 0.5) * 0.1 + 0.33
            k = int(math.degrees(math.atan2(y, x)) % 360)
            inside = ranges[k, 0] <= math.hypot(x, y) <= ranges[k, 1] and ranges[k, 1] > 0
            assert found[row, col] == (k if inside else -1)
    x0, y0, x1, y1 = covered_box(ranges)
    wide = azimuth_bins(ranges, 0.0, 0.0, 0.1, -40, -40, 80, 80) >= 0
    rows, cols = np.nonzero(wide)
    assert x0 <= (cols.min() - 39.5) * 0.1
    assert (cols.max() - 39.5) * 0.1 <= x1
    assert y0 <= (rows.min() - 39.5) * 0.1
    assert (rows.max() - 39.5) * 0.1 <= y1
