"""Where on the floor a camera looks, and crops of pictures around a box."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.geometry import Pinhole, Pose, camera_pose
from surveilnav.services.gateway.core.camera_views import _MAX_SIDE_PX, RANGE_M, crop, floor_outline

CAMERA = Pinhole.from_hfov(640, 480, math.radians(90))


def outline(at=(1.0, 2.0, 2.0), yaw=0.0, pitch=-0.5, floor_z_m=0.0):
    return np.array(floor_outline(Pose.from_matrix(camera_pose(at, yaw, pitch)), CAMERA, floor_z_m))


@given(st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(0.2, 4.0))
def test_no_farther_than_its_range_and_symmetric_about_its_axis(yaw, pitch, height_m):
    points = outline(at=(1.0, 2.0, height_m), yaw=yaw, pitch=pitch) - (1.0, 2.0)
    assert (np.linalg.norm(points, axis=1) <= RANGE_M + 1e-2).all()
    left = points @ (-math.sin(yaw), math.cos(yaw))
    assert abs(left.max() + left.min()) < 1e-2


def test_what_lies_inside_is_seen_and_what_lies_outside_isnt():
    """By projecting points of the floor into the picture."""
    T = camera_pose((1.0, 2.0, 2.0), 0.7, -0.6)
    polygon = np.array(floor_outline(Pose.from_matrix(T), CAMERA, 0.0), np.float32)
    rng = np.random.default_rng(0)
    for x, y in rng.uniform(-4, 7, (300, 2)):
        p = np.linalg.inv(T) @ (x, y, 0.0, 1.0)
        u, v = CAMERA.fx_px * p[0] / p[2] + CAMERA.cx_px, CAMERA.fy_px * p[1] / p[2] + CAMERA.cy_px
        away_m = math.hypot(x - 1, y - 2)
        margin = cv2.pointPolygonTest(polygon, (float(x), float(y)), True)
        if abs(margin) < 0.3 or abs(away_m - RANGE_M) < 0.5:  # the range's arc is drawn by chords
            continue
        seen = p[2] > 0 and -0.5 <= u <= 639.5 and -0.5 <= v <= 479.5 and away_m < RANGE_M
        assert seen == (margin > 0), (x, y)


def test_straight_down_it_sees_around_itself():
    points = outline(pitch=-math.pi / 2)
    assert (points.min(axis=0) < (1.0, 2.0)).all()
    assert (points.max(axis=0) > (1.0, 2.0)).all()


@pytest.mark.parametrize("floor_z_m", [math.nan, math.inf, -math.inf, 1e300])
def test_heights_that_are_none_give_numbers_all_the_same(floor_z_m):
    assert np.isfinite(outline(floor_z_m=floor_z_m)).all()


# --- crops --------------------------------------------------------------------------------------------------------

_PICTURE = np.zeros((300, 400, 3), np.uint8)
_PICTURE[100:200, 150:250] = (0, 0, 255)
JPEG = cv2.imencode(".jpg", _PICTURE)[1].tobytes()


def shown(box):
    return cv2.imdecode(np.frombuffer(crop(JPEG, box), np.uint8), cv2.IMREAD_COLOR)


def test_the_box_is_in_the_middle_with_what_is_around_it():
    picture = shown((150, 100, 250, 200))
    assert picture.shape == (170, 170, 3)  # 35 % of 100 px on each side
    assert picture[85, 85, 2] > 200
    assert picture[5, 5].max() < 40


@given(st.tuples(*[st.floats(-1e4, 1e4)] * 4))
def test_any_box_gives_a_small_picture_or_is_refused(box):
    try:
        picture = shown(box)
    except ValueError:
        return
    assert max(picture.shape) <= _MAX_SIDE_PX


@pytest.mark.parametrize(
    "box", [(), (1, 2, 3), (None, 0, 10, 10), (float("nan"), 0, 9, 9), (500, 0, 600, 10), (9, 9, 9, 9)]
)
def test_what_is_no_box_is_refused(box):
    with pytest.raises(ValueError):
        crop(JPEG, box)


@pytest.mark.parametrize("data", [b"", b"no picture", JPEG[:40]])
def test_what_is_no_picture_is_refused(data):
    with pytest.raises(ValueError):
        crop(data, (0, 0, 10, 10))
