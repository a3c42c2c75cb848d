"""Corrects estimated depth by the floor: where a view shows its floor, depth is known from the camera's pose and lens alone.

An estimated depth is wrong by a factor that changes slowly across the picture. On the floor that factor can be read off. So
the factor is fitted to the pixels that show floor, as a smooth field, and the whole picture is divided by it (the idea of
fitting scale and shift of a monocular depth network to a known plane; here with a prior, since not every view shows floor).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.messages import DepthUncertainty
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core.config import EstimatedDepthConfig

_MAX_FLOOR_M = 12.0
_CELLS = 96  # samples across a picture
_BIN = 0.02
_LOG_RATIOS = np.arange(-0.8, 0.6001, _BIN)
_ROUNDS = 4
#: A factor that is less likely than this is no error of scale: what looks like floor is something else.
_MAX_SCALE_SIGMAS = 3.0
_LEAST_SIGMA = 0.005
#: Degree in (u, v) of the smooth field; one number fewer than a 4 x 4 grid has, and steadier where no floor is seen.
_DEGREE = 3


@dataclass(frozen=True, slots=True, eq=False)
class FloorFit:
    """A view's depth, corrected.

    Attributes:
        depth_m: (H, W) float32; where the floor is seen, the depth of the floor.
        is_floor: (H, W) bool, where the floor is seen.
        sigma: standard deviation of the logarithm of the other depths.
    """

    depth_m: NDArray[np.float32]
    is_floor: NDArray[np.bool_]
    sigma: float


def floor_depth_m(camera: Pinhole, T_world_camera: Matrix4, floor_z_m: float) -> NDArray[np.float32]:
    """(H, W) float32: the depth [m] at which each pixel's ray meets the floor at altitude ``floor_z_m``; inf: it doesn't."""
    down = -(camera.rays() @ T_world_camera[2, :3])
    height_m = float(T_world_camera[2, 3]) - floor_z_m
    with np.errstate(divide="ignore"):
        depth = np.where((down > 1e-6) & (height_m > 0), height_m / down, np.inf)
    return depth.astype(np.float32)


def with_corrected_depth(view: PosedView, config: EstimatedDepthConfig) -> PosedView:
    """The view with its depth corrected if it is estimated; without depth if that can't be done."""
    if view.depth_source in ("sensor", "none"):
        return view
    fit = fit_floor(view, config)
    if fit is None:
        return replace(view, depth_m=np.zeros_like(view.depth_m), depth_source="none")
    return replace(view, depth_m=fit.depth_m, depth_uncertainty=DepthUncertainty(fit.sigma))


def fit_floor(view: PosedView, config: EstimatedDepthConfig) -> FloorFit | None:
    """Corrects a view's estimated depth; None if too little floor is seen to say how wrong it is.

    The floor is behind everything that stands on it. So its factor is the largest that many pixels share.
    """
    height_px, width_px = view.depth_m.shape
    step = max(1, round(width_px / _CELLS))
    floor_m = floor_depth_m(view.camera, view.T_world_camera, view.floor_z_m)
    sampled, floor = view.depth_m[::step, ::step], floor_m[::step, ::step]
    v, u = np.nonzero((sampled > 0) & (floor < _MAX_FLOOR_M))
    if len(v) < config.min_floor_samples:
        return None
    log_ratio = np.log(sampled[v, u] / floor[v, u]).astype(np.float64)
    scale = _floor_scale(log_ratio, view.depth_uncertainty.scale_sigma, config)
    if scale is None:
        return None
    warp_sigma = max(_LEAST_SIGMA, min(config.warp_sigma, view.depth_uncertainty.sigma))
    basis = _basis(v * step / height_px, u * step / width_px)
    inliers = np.abs(log_ratio - scale) < 2.0 * warp_sigma
    for _ in range(_ROUNDS):
        if np.count_nonzero(inliers) < config.min_floor_samples:
            return None
        weights = _ridge(basis[inliers], log_ratio[inliers] - scale, warp_sigma, config)
        field = scale + basis @ weights
        inliers = np.abs(log_ratio - field) < config.floor_tolerance
    if np.count_nonzero(inliers) < config.min_floor_share * len(v):
        return None
    rows, cols = np.mgrid[0 : height_px + step : step, 0 : width_px + step : step]
    coarse = (scale + _basis(rows / height_px, cols / width_px) @ weights).astype(np.float32)
    rows, cols = np.mgrid[0:height_px, 0:width_px].astype(np.float32) / step
    field = cv2.remap(coarse, cols, rows, cv2.INTER_LINEAR)
    depth_m, is_floor = _corrected(view, floor_m, field, config)
    return FloorFit(depth_m, is_floor, max(_LEAST_SIGMA, view.depth_uncertainty.sigma))


def _floor_scale(log_ratio: NDArray[np.float64], sigma: float, config: EstimatedDepthConfig) -> float | None:
    """The factor of the floor, as a logarithm: the largest that many pixels share; None if none stands out."""
    counts, _ = np.histogram(log_ratio, bins=_LOG_RATIOS)
    spread = max(1, round(config.warp_sigma / _BIN))
    kernel = np.exp(-0.5 * (np.arange(-3 * spread, 3 * spread + 1) / spread) ** 2)
    smooth = np.convolve(counts, kernel / kernel.sum(), mode="same")
    middles = (_LOG_RATIOS[:-1] + _LOG_RATIOS[1:]) / 2
    prior = np.exp(-0.5 * (middles / math.hypot(sigma, _BIN)) ** 2)
    likely = smooth * prior
    peaks = np.flatnonzero((likely[1:-1] >= likely[:-2]) & (likely[1:-1] > likely[2:])) + 1
    if not len(peaks):
        return None
    peak = float(middles[peaks[likely[peaks] >= config.floor_peak * likely[peaks].max()][-1]])
    near = log_ratio[np.abs(log_ratio - peak) <= 2 * _BIN]
    if abs(peak) > _MAX_SCALE_SIGMAS * math.hypot(sigma, _BIN):
        return None
    return float(np.median(near)) if len(near) else None


def _basis(v: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Products of Legendre polynomials of rows and columns, given as shares of the picture, up to ``_DEGREE`` together."""
    legendre = [np.polynomial.legendre.Legendre.basis(k) for k in range(_DEGREE + 1)]
    x, y = 2.0 * np.asarray(u) - 1.0, 2.0 * np.asarray(v) - 1.0
    products = [legendre[i](x) * legendre[j](y) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
    return np.stack(products, axis=-1)


def _ridge(
    basis: NDArray[np.float64], values: NDArray[np.float64], warp_sigma: float, config: EstimatedDepthConfig
) -> NDArray[np.float64]:
    """The weights (K,) of the basis that fit ``values``, each with a prior of N(0, ``warp_sigma``).

    Neighbouring pixels aren't independent: all of them together count as ``independent_samples``.
    """
    per_sample = config.independent_samples / max(len(values), config.independent_samples)
    noise = config.floor_tolerance**2 / per_sample
    normal = basis.T @ basis / noise + np.eye(basis.shape[1]) / warp_sigma**2
    return np.asarray(np.linalg.solve(normal, basis.T @ values / noise))


def _corrected(
    view: PosedView, floor_m: NDArray[np.float32], field: NDArray[np.float32], config: EstimatedDepthConfig
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The depth divided by e^``field``, and where it is the floor's, which it then is exactly."""
    depth_m = view.depth_m * np.exp(-field)
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond_floor = np.log(depth_m / floor_m)
    there = view.depth_m > 0
    is_floor = there & (np.abs(beyond_floor) < config.floor_tolerance)
    below = there & (beyond_floor >= config.floor_tolerance)  # nothing is below the floor
    return np.where(is_floor | below, floor_m, depth_m).astype(np.float32), is_floor
