"""Projection and back-projection are inverses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.geometry import Pinhole


@given(st.integers(2, 40), st.integers(2, 40), st.floats(0.2, 2.5), st.floats(0.1, 20))
def test_back_projection_round_trip(width, height, hfov, depth):
    camera = Pinhole.from_hfov(width, height, hfov)
    points = camera.back_project(np.full((height, width), depth, np.float32))
    uv = camera.project(points)
    v, u = np.mgrid[0:height, 0:width]
    np.testing.assert_allclose(uv, np.stack([u, v], -1), atol=2e-3)
    np.testing.assert_allclose(points[..., 2], depth, rtol=1e-6)
    assert camera.hfov_rad == pytest.approx(hfov)


def test_behind_the_camera_is_nowhere():
    uv = Pinhole.from_hfov(4, 4, 1.0).project(np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0]]))
    assert np.isnan(uv).all()


def test_resizing_keeps_the_rays():
    camera = Pinhole.from_hfov(640, 480, math.radians(79))
    small = camera.resized(320, 240)
    # The centre of a small pixel is the corner between four large ones.
    large = camera.rays()
    np.testing.assert_allclose(small.rays()[10, 20], large[20:22, 40:42].mean((0, 1)), atol=1e-6)


@pytest.mark.parametrize(
    "bad", [(0, 4, 1, 1, 0, 0), (4, 4, 0, 1, 0, 0), (4, 4, math.nan, 1, 0, 0), (4, 4, 1, 1, math.inf, 0)]
)
def test_cameras_that_are_none_are_refused(bad):
    with pytest.raises(ValueError, match=r"pixels|positive|finite"):
        Pinhole(*bad)
