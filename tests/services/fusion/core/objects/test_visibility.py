"""What a view should show: one object at a time in numpy, against the compiled many."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.geometry import inverse, transform_points
from surveilnav.services.fusion.core.objects.visibility import visible_shares


def reference(view, p_world, near_m, far_m):
    p = transform_points(inverse(view.T_world_camera), p_world)
    uv, z = view.camera.project(p), p[:, 2]
    height, width = view.depth_m.shape
    with np.errstate(invalid="ignore"):
        inside = (z >= near_m) & (z <= far_m) & np.all((uv >= 0) & (uv <= (width - 1, height - 1)), axis=1)
    if not inside.any():
        return 0.0, (-1.0, -1.0)
    u, v = uv[inside].round().astype(int).T
    depth_m = view.depth_m[v, u]
    clear = (depth_m > 0) & (depth_m >= z[inside].min() - 0.15)
    return np.count_nonzero(clear) / len(p), (np.median(u), np.median(v))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_as_one_by_one(tools, seed):
    rng = np.random.default_rng(seed)
    world = tools.world()
    world.boxes["screen"] = ((2.0, 0.5, 0.0), (2.1, 2.0, 1.2))
    view = world.view(*rng.uniform(0.3, 1.5, 2), rng.uniform(-math.pi, math.pi), -0.2)
    view.depth_m[rng.uniform(size=view.depth_m.shape) < 0.1] = rng.choice([0.0, np.nan])
    things = [rng.uniform(0, 4, 3) + rng.uniform(-0.5, 0.5, (int(rng.integers(1, 65)), 3)) for _ in range(6)]
    shares, pixels = visible_shares(view, things, 0.7, 3.5)
    for thing, share, pixel in zip(things, shares, pixels, strict=True):
        wanted_share, wanted_pixel = reference(view, thing, 0.7, 3.5)
        assert share == pytest.approx(wanted_share)
        assert tuple(pixel) == pytest.approx(wanted_pixel)


def test_no_objects_no_shares(world):
    shares, pixels = visible_shares(world.view(1.0, 1.0, 0.0), [], 0.7, 3.5)
    assert (shares.shape, pixels.shape) == ((0,), (0, 2))
