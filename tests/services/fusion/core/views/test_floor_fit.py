"""Estimated depth is corrected by the floor that the view shows."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from surveilnav.benchmark.play.depth_error import DepthError
from surveilnav.geometry import Pinhole, camera_pose
from surveilnav.messages import DepthUncertainty
from surveilnav.services.fusion.core.config import EstimatedDepthConfig
from surveilnav.services.fusion.core.views.floor_fit import fit_floor, floor_depth_m

LENS = Pinhole.from_hfov(200, 160, math.radians(90))
CONFIG = EstimatedDepthConfig()


def furnished(world):
    world.boxes |= {
        "table": ((2.5, 1.0, 0.0), (3.3, 1.8, 0.75)),
        "chair": ((3.0, 2.6, 0.0), (3.5, 3.1, 0.5)),
        "cupboard": ((4.6, 3.4, 0.0), (5.6, 4.0, 1.8)),
    }
    return world


def estimated(world, error: DepthError, seed: int, pitch: float = -0.5):
    """(a camera's view with wrong depth, its true depth)."""
    view = world.view(0.3, 2.0, 0.0, pitch, height=2.3, source="camera/c", camera=LENS)
    return replace(
        view, depth_m=error.apply(view.depth_m, seed), depth_source="network", depth_uncertainty=error.uncertainty
    ), view.depth_m


@settings(max_examples=40)
@given(
    x=st.floats(-5, 5),
    height=st.floats(0.5, 4.0),
    yaw=st.floats(-3, 3),
    pitch=st.floats(-1.5, 0.3),
    u=st.integers(0, 199),
    v=st.integers(0, 159),
)
def test_floor_depth_is_where_the_ray_meets_the_floor(x, height, yaw, pitch, u, v):
    T = camera_pose((x, 1.0, 0.7 + height), yaw, pitch)
    depth_m = float(floor_depth_m(LENS, T, 0.7)[v, u])
    ray = np.array([(u - LENS.cx_px) / LENS.fx_px, (v - LENS.cy_px) / LENS.fy_px, 1.0])
    if math.isinf(depth_m):
        assert (T[:3, :3] @ ray)[2] > -1e-5
    else:
        p_world = T[:3, 3] + depth_m * (T[:3, :3] @ ray)
        assert p_world[2] == pytest.approx(0.7, abs=1e-4 * max(1.0, depth_m))


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 10_000))
def test_a_wrong_scale_and_a_warp_are_corrected(world, seed):
    view, true_m = estimated(furnished(world), DepthError(0.15, 0.06), seed)
    fit = fit_floor(view, CONFIG)
    assert fit is not None
    floor_m = floor_depth_m(view.camera, view.T_world_camera, 0.0)
    shows_floor = np.abs(true_m - floor_m) < 1e-3
    np.testing.assert_array_equal(fit.depth_m[fit.is_floor], floor_m[fit.is_floor])
    assert shows_floor[fit.is_floor].mean() > 0.8, "what is called floor is floor"
    assert fit.is_floor[shows_floor].mean() > 0.55, "and most of the floor is found"
    things = ~shows_floor & ~fit.is_floor
    error = np.abs(np.log(fit.depth_m[things] / true_m[things]))
    assert np.median(error) < 0.1
    assert (fit.depth_m <= floor_m * 1.0001)[np.isfinite(floor_m)].all(), "nothing is below the floor"


def test_true_depth_stays_as_it_is(world):
    view, true_m = estimated(furnished(world), DepthError(0.0, 0.0), 0)
    fit = fit_floor(view, CONFIG)
    assert fit is not None
    assert np.median(np.abs(np.log(fit.depth_m / true_m))) < 0.005


def test_a_view_that_shows_no_floor_says_nothing(world):
    view, _ = estimated(world, DepthError(0.05, 0.04), 1, pitch=0.9)
    assert fit_floor(view, CONFIG) is None
    nothing = replace(view, depth_m=np.zeros_like(view.depth_m))
    assert fit_floor(nothing, CONFIG) is None


def test_a_low_bed_that_fills_the_view_is_not_the_floor_of_a_network_that_knows_its_scale(world):
    """The bed's top is at 0.75 of the floor's depth: too far off for an error of 5 %."""
    world.boxes["bed"] = ((0.9, 0.0, 0.0), (3.2, 4.0, 0.575))
    view, _ = estimated(world, DepthError(0.0, 0.0), 0, pitch=-0.7)
    fit = fit_floor(replace(view, depth_uncertainty=DepthUncertainty(0.05, 0.05)), CONFIG)
    assert fit is not None
    on_bed = view.depth_m < 0.9 * floor_depth_m(view.camera, view.T_world_camera, 0.0)
    assert fit.is_floor[on_bed].mean() < 0.05
