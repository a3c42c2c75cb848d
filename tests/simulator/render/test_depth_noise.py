"""The depth noise model: its figures, its seed, its switches."""

from __future__ import annotations

import math

import numpy as np
import pytest

from surveilnav.geometry import Pinhole
from surveilnav.simulator.render.depth_noise import DepthNoise

CAMERA = Pinhole.from_hfov(320, 240, math.radians(79))


def wall(z_m: float) -> np.ndarray:
    return np.full((240, 320), z_m, dtype=np.float32)


@pytest.mark.parametrize("preset", [DepthNoise.robot(), DepthNoise.camera()])
def test_same_seed_same_bytes_other_seed_other_bytes(preset):
    a, b, c = (preset.apply(wall(3.0), CAMERA, seed) for seed in (7, 7, 8))
    assert a.tobytes() == b.tobytes()
    assert (a != c).mean() > 0.3


def test_threads_do_not_change_it(monkeypatch):
    pictures = []
    for cores in (1, 3):
        monkeypatch.setattr("os.cpu_count", lambda cores=cores: cores)
        pictures.append(DepthNoise.robot().apply(wall(3.0), CAMERA, 1).tobytes())
    assert pictures[0] == pictures[1]


def test_none_changes_nothing():
    depth = np.random.default_rng(0).uniform(0, 9, (240, 320)).astype(np.float32)
    np.testing.assert_array_equal(DepthNoise().apply(depth, CAMERA, 3), depth)


@pytest.mark.parametrize("z_m", [0.5, 1.0, 2.0, 4.0])
def test_axial_sigma_is_nguyens(z_m):
    """Nguyen 2012 eq. 3: sigma = 0.0012 + 0.0019 (z - 0.4)^2 [m]."""
    only_axial = DepthNoise(axial_m=0.0012, axial_per_m=0.0019, axial_z0_m=0.4)
    error = only_axial.apply(wall(z_m), CAMERA, 5).astype(np.float64) - z_m
    expected = 0.0012 + 0.0019 * (z_m - 0.4) ** 2
    assert error.std() == pytest.approx(expected, rel=0.02)
    assert abs(error.mean()) < 0.02 * expected


def test_quantisation_is_in_disparity():
    ramp = np.linspace(1.0, 6.0, 240 * 320, dtype=np.float32).reshape(240, 320)
    out = DepthNoise(disparity_step=0.0028).apply(ramp, CAMERA, 0).astype(np.float64)
    steps = 1.0 / out / 0.0028
    np.testing.assert_allclose(steps, np.round(steps), atol=2e-4)
    assert np.abs(out - ramp).max() < 0.0028 / 2 * 6.0**2 * 1.05  # half a step of 1/z is z^2 / 2 steps of z


def test_lateral_jitter_moves_edges_by_about_a_pixel():
    depth = wall(1.0)
    depth[:, 160:] = 4.0
    out = DepthNoise(lateral_px=0.8).apply(depth, CAMERA, 2)
    assert set(np.unique(out)) == {1.0, 4.0}
    changed = (out != depth).mean(axis=0)
    assert changed[159] > 0.1
    assert changed[160] > 0.1
    assert not changed[:155].any()
    assert not changed[166:].any()


def test_grazing_surfaces_drop_out_and_steep_ones_stay():
    """A floor 1 m below a level camera: its rays meet it at grazing angles far away, at steep ones nearby."""
    y = (np.arange(240) - CAMERA.cy_px) / CAMERA.fy_px
    depth = np.where(y > 0.02, 1.0 / np.maximum(y, 0.02), 0.0).astype(np.float32)[:, None].repeat(320, axis=1)
    out = DepthNoise(grazing_cos=0.10).apply(depth, CAMERA, 0)
    middle_column = out[:, 160]
    rows = np.flatnonzero(depth[:, 160] > 0)[2:-2]
    cosine = y[rows] / np.sqrt(1 + y[rows] ** 2)
    assert (middle_column[rows[cosine < 0.095]] == 0).all()
    assert (middle_column[rows[cosine > 0.105]] > 0).all()


def test_no_depth_stays_none_and_share_of_dropouts():
    assert not DepthNoise.robot().apply(wall(0.0), CAMERA, 1).any()
    assert not DepthNoise.robot().apply(np.full((240, 320), np.nan, np.float32), CAMERA, 1).any()
    assert (DepthNoise(dropout=0.05).apply(wall(2.0), CAMERA, 1) == 0).mean() == pytest.approx(0.05, abs=0.01)
