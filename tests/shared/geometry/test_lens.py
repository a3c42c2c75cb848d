from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.geometry import Pinhole, camera_pose
from surveilnav.geometry.lens import BrownConrady, KannalaBrandt, Lens, Undistortion

PICTURE = Pinhole(1280, 960, 700.0, 690.0, 650.0, 470.0)
MATRIX = np.array([[700.0, 0, 650.0], [0, 690.0, 470.0], [0, 0, 1]])
BARREL = (-0.28, 0.09, 0.001, -0.0007, -0.012)
EQUIDISTANT = Pinhole(1000, 1000, 300.0, 300.0, 499.5, 499.5)
small = st.floats(-0.6, 0.6)


@given(x=small, y=small)
def test_brown_conrady_is_opencvs(x: float, y: float) -> None:
    rays = np.array([[x, y, 1.0]])
    expected = cv2.projectPoints(rays * 3.0, np.zeros(3), np.zeros(3), MATRIX, np.array(BARREL))[0].reshape(2)
    assert BrownConrady(PICTURE, BARREL).pixels(rays * 3.0)[0] == pytest.approx(expected, abs=1e-6)


@given(x=small, y=small)
def test_rational_model_is_opencvs(x: float, y: float) -> None:
    rational = (0.5, 0.1, 0.0003, -0.0002, 0.01, 0.8, 0.2, 0.03)
    expected = cv2.projectPoints(np.array([[x, y, 1.0]]), np.zeros(3), np.zeros(3), MATRIX, np.array(rational))[0]
    got = BrownConrady(PICTURE, rational).pixels(np.array([[x, y, 1.0]]))[0]
    assert got == pytest.approx(expected.reshape(2), abs=1e-6)


@given(x=st.floats(-3, 3), y=st.floats(-3, 3))
def test_kannala_brandt_is_opencvs_in_front_of_the_lens(x: float, y: float) -> None:
    k = (-0.01, 0.004, -0.002, 0.0003)
    rays = np.array([[[x, y, 1.0]]])
    expected = cv2.fisheye.projectPoints(rays, np.zeros(3), np.zeros(3), MATRIX, np.array(k))[0].reshape(2)
    assert KannalaBrandt(PICTURE, k).pixels(rays)[0, 0] == pytest.approx(expected, abs=1e-6)


def test_a_fisheye_sees_behind_itself_up_to_its_angle() -> None:
    lens = KannalaBrandt(EQUIDISTANT, max_angle_rad=math.radians(100))
    at_95, at_105 = (np.array([math.sin(math.radians(a)), 0.0, math.cos(math.radians(a))]) for a in (95, 105))
    assert lens.pixels(at_95) == pytest.approx([499.5 + 300 * math.radians(95), 499.5])
    assert np.isnan(lens.pixels(at_105)).all()


def test_a_polynomial_that_folds_back_shows_nothing_beyond_the_fold() -> None:
    lens = BrownConrady(PICTURE, (-0.28, 0.0))  # grows up to r = 1.09
    assert np.isfinite(lens.pixels(np.array([1.05, 0.0, 1.0]))).all()
    assert np.isnan(lens.pixels(np.array([1.15, 0.0, 1.0]))).all()
    assert np.isnan(lens.pixels(np.array([0.1, 0.0, -1.0]))).all()


def test_undistorted_straight_lines_are_straight() -> None:
    """A grid of lines seen through a barrel lens; each pixel of the undistorted picture shows what a pinhole camera sees."""
    lens, view = BrownConrady(PICTURE, BARREL), Pinhole.from_hfov(640, 480, math.radians(70))
    v, u = np.mgrid[0:960, 0:1280].astype(np.float64)
    rays = cv2.undistortPoints(np.stack([u, v], -1).reshape(-1, 1, 2), MATRIX, np.array(BARREL)).reshape(960, 1280, 2)
    distorted = _pattern(rays[..., 0], rays[..., 1])
    ours = Undistortion.from_lens(lens, view).picture(distorted)
    x, y = view.rays()[..., 0], view.rays()[..., 1]
    error = np.abs(ours.astype(int) - _pattern(x, y))
    assert np.percentile(error, 99) <= 3


def test_a_ceiling_fisheye_becomes_the_view_of_a_camera_that_looks_down_thirty_degrees() -> None:
    T_world_lens = camera_pose((0, 0, 2.5), 0.0, -math.pi / 2)
    T_world_view = camera_pose((0, 0, 2.5), 1.0, math.radians(-30))
    view = Pinhole.from_hfov(320, 320, math.radians(100))
    R_lens_view = T_world_lens[:3, :3].T @ T_world_view[:3, :3]
    lens = KannalaBrandt(EQUIDISTANT, max_angle_rad=math.radians(95))
    undistortion = Undistortion.from_lens(lens, view, R_lens_view)
    rays_world = view.rays() @ T_world_view[:3, :3].T
    angle = np.arccos(-rays_world[..., 2] / np.linalg.norm(rays_world, axis=-1))
    assert (undistortion.seen == (angle <= math.radians(95))).mean() > 0.999
    expected = 300.0 * angle  # equidistant: the distance from the principal point
    uv = (undistortion.map_px + 0.5) * undistortion.shrink - 0.5
    distance = np.hypot(*(uv - 499.5).transpose(2, 0, 1))
    assert distance[undistortion.seen] == pytest.approx(expected[undistortion.seen], abs=1e-3)


def test_a_picture_is_shrunk_before_its_pixels_are_skipped() -> None:
    """A chequerboard of single pixels is grey in a view of a quarter of the size; else it would be black or white."""
    lens = Pinhole.from_hfov(1200, 900, math.radians(80))
    board = np.indices((900, 1200)).sum(0) % 2
    picture = np.repeat((255 * board)[..., None], 3, -1).astype(np.uint8)
    undistortion = Undistortion.from_lens(BrownConrady(lens), lens.resized(300, 225))
    assert undistortion.shrink == 4
    assert np.abs(undistortion.picture(picture).astype(int) - 127).max() <= 1


def test_what_the_lens_does_not_see_is_black_and_masked() -> None:
    undistortion = Undistortion.from_lens(BrownConrady(PICTURE), Pinhole.from_hfov(200, 200, math.radians(150)))
    white = undistortion.picture(np.full((960, 1280, 3), 255, np.uint8))
    assert 0.03 < undistortion.seen.mean() < 0.9
    assert (white[undistortion.seen] == 255).all()
    assert (white[~undistortion.seen] == 0).all()
    assert (undistortion.mask(np.zeros((960, 1280), bool)) == ~undistortion.seen).all()


def test_no_masked_pixel_reaches_the_undistorted_picture() -> None:
    undistortion = Undistortion.from_lens(BrownConrady(PICTURE, BARREL), Pinhole.from_hfov(400, 300, math.radians(70)))
    zone = np.zeros((960, 1280), bool)
    zone[300:420, 500:733] = True
    secret = np.where(zone[..., None], 255, 0).repeat(3, -1).astype(np.uint8)
    shown = undistortion.picture(secret)
    shown[undistortion.mask(zone)] = 0
    assert (shown == 0).all()
    assert undistortion.mask(zone).mean() < 0.1


@pytest.mark.parametrize(
    "make", [lambda: BrownConrady(PICTURE, (0.1, 0.2, 0.3)), lambda: KannalaBrandt(PICTURE, (0.1,))]
)
def test_a_wrong_number_of_coefficients_is_named(make) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ValueError, match="coefficients, got"):
        make()


def _pattern(x, y):  # type: ignore[no-untyped-def]
    grey = 127 + 60 * np.sin(12 * x) + 60 * np.cos(9 * y)
    return np.repeat(grey[..., None], 3, -1).astype(np.uint8)


@pytest.mark.parametrize(
    "lens",
    [
        BrownConrady(PICTURE),
        BrownConrady(PICTURE, BARREL),
        BrownConrady(PICTURE, (0.1, 0.05, 0.01, -0.01)),
        KannalaBrandt(PICTURE),
        KannalaBrandt(PICTURE, (-0.02, 0.003, 0.0, 0.0)),
    ],
    ids=repr,
)
def test_a_pixel_s_ray_leads_back_to_it(lens: Lens) -> None:
    pixels = np.stack(
        np.meshgrid(np.linspace(0, PICTURE.width_px - 1, 9), np.linspace(0, PICTURE.height_px - 1, 7)), -1
    )
    rays = lens.rays(pixels)
    seen = np.isfinite(rays).all(axis=-1)
    assert seen.mean() > 0.5
    assert seen[3, 4]
    assert np.linalg.norm(rays[seen], axis=-1) == pytest.approx(np.ones(seen.sum()))
    assert lens.pixels(rays)[seen] == pytest.approx(pixels[seen], abs=1e-4)


def test_no_ray_leads_to_a_pixel_beyond_what_the_lens_sees() -> None:
    narrow = KannalaBrandt(PICTURE, (), max_angle_rad=0.2)
    inside = PICTURE.cx_px + 0.19 * PICTURE.fx_px, PICTURE.cy_px
    assert np.isfinite(narrow.rays(np.array(inside))).all()
    assert np.isnan(narrow.rays(np.array([inside[0] + 0.02 * PICTURE.fx_px, inside[1]]))).all()


def test_the_field_of_view_of_a_fisheye_is_twice_the_angle_at_its_edge() -> None:
    lens = KannalaBrandt(Pinhole(1000, 800, 320.0, 320.0, 499.5, 399.5), (-0.02, 0.003, 0.0, 0.0))
    half = lens.hfov_rad / 2
    edge = lens.pixels(np.array([math.sin(half), 0.0, math.cos(half)]))
    assert edge[0] == pytest.approx(999.5, abs=1e-3)
    assert KannalaBrandt(Pinhole(1000, 800, 100.0, 100.0, 499.5, 399.5)).hfov_rad == pytest.approx(2 * math.pi)
