"""Scale and shift of estimated depth, fitted to the floor: found among furniture, refused where there is no floor."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4, Pinhole, camera_pose
from surveilnav.perception.depth.floor_scale import FloorSamples, FloorScale, fit_floor_scale
from surveilnav.perception.depth.reference import reference_depth

CAMERA = Pinhole.from_hfov(64, 48, 1.5)


def room(T_world_camera: Matrix4, rng: np.random.Generator, n_things: int) -> NDArray[np.float64]:
    """(H, W) depth of a room of 6 x 6 m with boxes on its floor; the camera is in one of its corners."""
    rays = CAMERA.rays().astype(np.float64) @ T_world_camera[:3, :3].T
    origin = T_world_camera[:3, 3]
    walls = np.array([[-0.2, -0.2, 0.0], [5.8, 5.8, 3.2]])
    with np.errstate(divide="ignore"):
        # Inside a box, a ray leaves through the nearest of the planes that it goes towards.
        depth = np.min(np.where(rays > 0, walls[1] - origin, walls[0] - origin) / rays, axis=-1)
        for _ in range(n_things):
            low = np.array([*rng.uniform(0.5, 4.8, 2), 0.0])
            high = low + rng.uniform(0.3, (1.2, 1.2, 1.6))
            ends = np.sort(np.stack([(low - origin) / rays, (high - origin) / rays]), axis=0)
            enters, leaves = ends[0].max(axis=-1), ends[1].min(axis=-1)
            depth = np.where((enters < leaves) & (enters > 0.1), np.minimum(depth, enters), depth)
    return depth


def pose(height_m: float, pitch_deg: float) -> Matrix4:
    return camera_pose((0.0, 0.0, height_m), math.radians(45.0), math.radians(pitch_deg))


def samples(T: Matrix4, true_m: NDArray[np.float64], estimated_m: NDArray[np.float64]) -> FloorSamples:
    reference = reference_depth(CAMERA, T, 0.0)
    there = reference.floor & (estimated_m > 0)
    return FloorSamples(estimated_m[there].astype(np.float64), reference.depth_m[there].astype(np.float64))


def fitted(scale: float, shift_m: float, seed: int, T: Matrix4, n_pictures: int = 3, n_things: int = 5) -> FloorScale:
    """The fit to pictures that are wrong by this scale and shift, each by 2 % more, and 2 % of noise."""
    rng = np.random.default_rng(seed)
    pictures = []
    for _ in range(n_pictures):
        true_m = room(T, rng, n_things)
        wrong = (true_m - shift_m) / scale * np.exp(rng.normal(0, 0.02) + rng.normal(0, 0.02, true_m.shape))
        pictures.append(samples(T, true_m, wrong))
    fit = fit_floor_scale(pictures)
    assert fit is not None
    return fit


@settings(max_examples=40, deadline=None)
@given(
    scale=st.floats(0.75, 1.3),
    shift_m=st.floats(-0.15, 0.15),
    height_m=st.floats(2.0, 3.0),
    pitch_deg=st.floats(-55, -25),
    seed=st.integers(0, 10_000),
)
def test_scale_and_shift_are_found_among_furniture(
    scale: float, shift_m: float, height_m: float, pitch_deg: float, seed: int
) -> None:
    T = pose(height_m, pitch_deg)
    true_m = room(T, np.random.default_rng(seed), 5)
    reference = reference_depth(CAMERA, T, 0.0)
    seen = reference.floor & (np.abs(true_m / reference.depth_m - 1) < 0.01)
    assume(seen.sum() > 0.25 * reference.floor.sum())
    fit = fitted(scale, shift_m, seed, T)
    # Scale and shift replace each other where the floor's depths differ little: what counts is the depth.
    near_m, far_m = np.quantile(reference.depth_m[seen], (0.1, 0.9))
    for depth_m in (near_m, far_m):
        assert fit.apply(np.array([(depth_m - shift_m) / scale]))[0] == pytest.approx(depth_m, rel=0.05)
    assert 0.02 <= fit.floor_sigma <= 0.08


def test_more_pictures_make_it_more_certain_and_their_own_scales_are_told() -> None:
    T = pose(2.5, -35.0)
    few, many = fitted(1.15, 0.05, 3, T, 2), fitted(1.15, 0.05, 3, T, 16)
    assert many.covariance[0, 0] < 0.5 * few.covariance[0, 0]
    assert many.scale == pytest.approx(1.15, abs=0.05)
    assert 0.03 <= many.picture_sigma < few.picture_sigma < 0.08  # the pictures' own scales have a sigma of 2 %
    assert many.n_pictures == 16


def test_what_was_extrapolated_is_less_certain() -> None:
    fit = fitted(1.1, 0.0, 5, pose(2.5, -50.0))
    near, middle, far = fit.fit_sigma(np.array([0.5, 2.5, 9.0]))
    assert near > middle
    assert far > middle


def test_pixels_of_the_floor_are_told_from_those_of_furniture() -> None:
    T, rng = pose(2.5, -35.0), np.random.default_rng(8)
    fit = fitted(0.85, 0.1, 8, T)
    true_m, reference = room(T, rng, 6), reference_depth(CAMERA, T, 0.0)
    floor_m = np.where(reference.floor, reference.depth_m, np.inf)
    chance = fit.floor_chance(fit.apply((true_m - 0.1) / 0.85), floor_m)
    is_floor = reference.floor & (np.abs(true_m / reference.depth_m - 1) < 0.01)
    assert (chance[is_floor] > 0.5).mean() > 0.97
    assert (chance[reference.floor & (true_m < 0.8 * reference.depth_m)] > 0.5).mean() < 0.02
    assert not chance[~reference.floor].any()


@pytest.mark.parametrize("scale", [0.8, 1.0, 1.25])
@pytest.mark.parametrize("wall_m", [0.7, 1.5, 2.5, 4.0])
def test_a_wall_is_no_floor(scale: float, wall_m: float) -> None:
    T = pose(2.5, -20.0)
    down = -(CAMERA.rays().astype(np.float64) @ T[2, :3])
    ahead = CAMERA.rays().astype(np.float64) @ (T[:3, :3].T @ [math.sqrt(0.5), math.sqrt(0.5), 0.0])
    true_m = wall_m / ahead  # upright, across the whole picture; it has no foot
    assert (true_m * down < 2.5).mean() > 0.3
    assert fit_floor_scale([samples(T, true_m, true_m / scale)]) is None


def test_a_picture_full_of_clutter_is_no_floor() -> None:
    T = pose(2.5, -35.0)
    rng = np.random.default_rng(2)
    reference = reference_depth(CAMERA, T, 0.0)
    clutter = reference.depth_m * rng.uniform(0.25, 0.9, reference.depth_m.shape)
    assert fit_floor_scale([samples(T, clutter, clutter)]) is None


def test_nothing_is_no_floor() -> None:
    assert fit_floor_scale([]) is None
    assert fit_floor_scale([FloorSamples(np.zeros(0), np.zeros(0))]) is None
