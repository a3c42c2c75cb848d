"""Channels of depth against slow code: points, a plane's normal, places without depth."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.geometry import Pinhole
from surveilnav.perception.detectors.depth_channels import N_CHANNELS, depth_channels

LENS = Pinhole.from_hfov(640, 480, 1.38)
slopes = st.floats(-0.6, 0.6)


def plane(normal: np.ndarray, away_m: float) -> np.ndarray:
    """(480, 640) depth of a plane whose points p fulfil ``normal . p = away_m``."""
    return (away_m / (LENS.rays() @ normal)).astype(np.float32)


@given(slopes, slopes, st.floats(0.5, 4.0))
def test_a_planes_normal_and_distance_are_found(x: float, y: float, away_m: float) -> None:
    normal = np.array([x, y, 1.0]) / np.linalg.norm([x, y, 1.0])
    channels = depth_channels(plane(normal, away_m), LENS, 160, 120)
    inner = channels[3:-3, 3:-3]
    np.testing.assert_allclose(inner[..., 4:7], np.broadcast_to(normal, inner[..., 4:7].shape), atol=0.02)
    lens = LENS.resized(160, 120)
    for row, column in ((10, 20), (60, 80), (110, 150)):
        ray = lens.rays()[row, column]
        z = away_m / (ray @ normal)
        share, inverse, size, height = channels[row, column, :4]
        assert share == 1.0
        assert inverse == pytest.approx(min(3.0, 1 / z), rel=0.02)
        assert np.exp(size / 0.7 - 3.5) == pytest.approx(z / lens.fx_px, rel=0.02)
        assert 2 * height == pytest.approx(ray[1] * z, abs=0.02)


def test_where_there_is_no_depth_all_is_zero_and_no_normal_leans_on_it() -> None:
    depth = plane(np.array([0.0, 0.0, 1.0]), 2.0)
    depth[:, 320:] = 0.0
    channels = depth_channels(depth, LENS, 160, 120)
    assert channels.shape == (120, 160, N_CHANNELS)
    assert (channels[:, 80:] == 0).all()
    assert (channels[:, 78:80, 4:7] == 0).all()
    assert (channels[:, :80, 0] == 1).all()
    assert (depth_channels(np.zeros((480, 640), np.float32), LENS, 160, 120) == 0).all()


def test_a_cell_is_the_mean_of_what_it_covers() -> None:
    """Noise that differs from pixel to pixel shrinks; a hole in a cell leaves the rest of it."""
    rng = np.random.default_rng(0)
    depth = (1.0 / (0.5 + rng.normal(0, 0.01, (480, 640)))).astype(np.float32)
    assert depth_channels(depth, LENS, 160, 120)[..., 1].std() == pytest.approx(0.01 / 4, rel=0.1)
    depth[::2] = 0.0
    channels = depth_channels(depth, LENS, 160, 120)
    assert (channels[..., 0] == 0.5).all()
    assert channels[..., 1].mean() == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("size", [(1, 1), (7, 5), (1280, 1280)])
def test_any_size_will_do(size: tuple[int, int]) -> None:
    camera = Pinhole.from_hfov(*size, 1.7)
    depth = np.full(size[::-1], 1e-3, np.float32)
    depth[0, 0] = 1e4
    channels = depth_channels(depth, camera, 208, 208)
    assert np.isfinite(channels).all()
    assert np.abs(channels).max() < 4
