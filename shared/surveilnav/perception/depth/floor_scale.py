"""Scale and shift of a camera's estimated depth, fitted to the floor: there, the true depth is known from the camera's pose.

A network that knows nothing of the camera's pose gives depths that are wrong by a factor, and by a distance. Both are found from
the pixels that show the floor. Which these are isn't known either; it follows from agreement with the plane. So the depths of
all pixels whose ray meets the floor are a mixture: the floor itself, what stands before it, and a few errors behind it. Its most
probable scale and shift are searched in a grid, and refined by expectation maximisation (Dempster et al. 1977).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.perception.depth.estimate import SCALE_SIGMA

#: Before any picture: metric networks are 10 to 20 % wrong in scale. Shift in metres.
_PRIOR_LOG_SCALE_SIGMA, _PRIOR_SHIFT_SIGMA_M = 0.2, 0.15
_LOG_SCALES, _SHIFTS_M = np.linspace(-0.6, 0.6, 61), np.linspace(-0.4, 0.4, 17)
#: Logarithms of depth over the floor's: what is not floor lies anywhere in this range, most of it before the floor.
_NEAREST, _FARTHEST = -1.6, 0.8
#: The mixture before it is fitted: shares of floor, nearer and farther pixels, and the floor's standard deviation.
_SHARES, _FLOOR_SIGMA = (0.5, 0.45, 0.05), 0.06
_FLOOR_SIGMAS = (0.02, 0.12)
_MAX_BELOW_SHARE = 0.1
#: Neighbouring pixels aren't independent: all of a picture count as so many.
_INDEPENDENT = 30.0
_ROUNDS = 20
_MAX_GRID_SAMPLES = 3000
#: The floor is found if it has so large a share of the pixels and, unless it has most of them, so large a range of depths. A wall
#: agrees with the floor in the rows where they meet, but in no range of depths.
_MIN_SHARE, _MIN_SAMPLES, _SURE_SHARE, _MIN_RANGE = 0.15, 150, 0.6, 1.4
#: Pixels of the floor are so many times as many as those just before it, in a range of the same width.
_MIN_PEAK, _PEAK_SIGMAS = 1.5, 1.5
#: The scale of single pictures varies about the camera's by this much, which counts as so many pictures.
_PICTURE_SIGMA, _PICTURE_SIGMA_COUNTS = 0.08, 3.0
_MIN_IN_PICTURE = 40


@dataclass(frozen=True, slots=True, eq=False)
class FloorSamples:
    """Pixels of one picture whose rays meet the floor.

    Attributes:
        estimated_m: (N,) depth by the network, above 0.
        floor_m: (N,) depth at which the ray meets the floor.
    """

    estimated_m: NDArray[np.float64]
    floor_m: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FloorScale:
    """How a camera's estimated depth is corrected: depth = ``scale`` * estimated + ``shift_m``.

    Attributes:
        covariance: (2, 2) of scale and shift [m].
        floor_sigma: standard deviation of the logarithm of the floor's depth after that, within and between pictures.
        picture_sigma: the part of it that all pixels of a picture have in common.
        floor_share: share of the pixels before or on the floor that show the floor.
        n_pictures: that it was fitted to.
    """

    scale: float
    shift_m: float
    covariance: NDArray[np.float64]
    floor_sigma: float
    picture_sigma: float
    floor_share: float
    n_pictures: int

    def apply(self, estimated_m: NDArray[np.floating]) -> NDArray[np.float32]:
        """Corrected depth [m]; 0 where it is unknown or wouldn't be in front of the camera."""
        depth_m = self.scale * estimated_m + self.shift_m
        return np.where((estimated_m > 0) & (depth_m > 0), depth_m, 0.0).astype(np.float32)

    def fit_sigma(self, estimated_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Standard deviation of the logarithm of the corrected depth by the uncertainty of scale and shift alone."""
        variance_m2 = (
            self.covariance[0, 0] * estimated_m**2 + 2 * self.covariance[0, 1] * estimated_m + self.covariance[1, 1]
        )
        return np.asarray(np.sqrt(np.maximum(variance_m2, 0.0)) / np.maximum(self.apply(estimated_m), 1e-3))

    def floor_chance(self, depth_m: NDArray[np.floating], floor_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """The chance that a pixel shows the floor, by its corrected depth and the floor's; 0 where a ray meets none."""
        known = (depth_m > 0) & np.isfinite(floor_m)
        residual = np.log(np.where(known, depth_m, 1.0) / np.where(known, floor_m, 1.0))
        shares = (self.floor_share, 1.0 - self.floor_share, _SHARES[2])
        return np.where(known, _floor_posterior(residual, shares, self.floor_sigma)[0], 0.0)


def fit_floor_scale(pictures: Sequence[FloorSamples]) -> FloorScale | None:
    """Fits scale and shift to a camera's pictures; None if they don't show enough floor to tell it from a wall or a table."""
    pictures = [picture for picture in pictures if len(picture.floor_m)]
    if not pictures:
        return None
    estimated_m = np.concatenate([picture.estimated_m for picture in pictures])
    floor_m = np.concatenate([picture.floor_m for picture in pictures])
    weights = np.concatenate([_picture_weights(len(picture.floor_m)) for picture in pictures])
    scale, shift_m = _best_of_grid(estimated_m, floor_m, weights)
    shares, sigma = _SHARES, _FLOOR_SIGMA
    for _ in range(_ROUNDS):
        residual = _residual(estimated_m, floor_m, scale, shift_m)
        on_floor, shares = _floor_posterior(residual, shares, sigma, weights)
        counted = weights * on_floor
        scale, shift_m, covariance = _solved(estimated_m, floor_m, counted, sigma)
        residual = _residual(estimated_m, floor_m, scale, shift_m)
        sigma = float(np.clip(math.sqrt((counted @ residual**2) / max(counted.sum(), 1e-9)), *_FLOOR_SIGMAS))
    is_floor = on_floor > 0.5
    if not _is_plausible(is_floor, floor_m, weights, residual / sigma):
        return None
    picture_sigma = _picture_sigma(residual, is_floor, [len(picture.floor_m) for picture in pictures])
    share = float(weights[is_floor].sum() / weights.sum())
    return FloorScale(scale, shift_m, covariance, sigma, picture_sigma, share, len(pictures))


def _picture_weights(n: int) -> NDArray[np.float64]:
    return np.full(n, min(1.0, _INDEPENDENT / n))


def _residual(
    estimated_m: NDArray[np.float64], floor_m: NDArray[np.float64], scale: float, shift_m: float
) -> NDArray[np.float64]:
    """Logarithm of corrected depth over the floor's."""
    return np.asarray(np.log(np.maximum(scale * estimated_m + shift_m, 1e-3) / floor_m))


def _densities(residual: NDArray[np.float64], shares: Sequence[float], sigma: float) -> list[NDArray[np.float64]]:
    """Densities of floor, nearer and farther pixels, times their shares."""
    floor = np.exp(-0.5 * (residual / sigma) ** 2) / (sigma * math.sqrt(2.0 * math.pi))
    nearer = np.where(residual < 0.0, 1.0 / -_NEAREST, 1e-6)
    farther = np.where(residual >= 0.0, 1.0 / _FARTHEST, 1e-6)
    return [share * density for share, density in zip(shares, (floor, nearer, farther), strict=True)]


def _floor_posterior(
    residual: NDArray[np.float64], shares: Sequence[float], sigma: float, weights: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float64], tuple[float, float, float]]:
    """(the chance of each pixel to show the floor, the shares of floor, nearer and farther pixels that follow from it)."""
    densities = _densities(residual, shares, sigma)
    total = sum(densities)
    weights = np.ones(residual.shape) if weights is None else weights
    floor, nearer, farther = (float((weights * part / total).sum() / weights.sum()) for part in densities)
    return densities[0] / total, (floor, nearer, min(farther, _MAX_BELOW_SHARE))


def _best_of_grid(
    estimated_m: NDArray[np.float64], floor_m: NDArray[np.float64], weights: NDArray[np.float64]
) -> tuple[float, float]:
    """The most probable (scale, shift) of a grid: as much floor as possible, and hardly anything below it."""
    step = max(1, len(floor_m) // _MAX_GRID_SAMPLES)
    estimated_m, floor_m, weights = estimated_m[::step], floor_m[::step], weights[::step] * step
    best, found = -math.inf, (1.0, 0.0)
    for shift_m in _SHIFTS_M:
        for log_scale in _LOG_SCALES:
            residual = _residual(estimated_m, floor_m, math.exp(log_scale), float(shift_m))
            density = np.sum(_densities(residual, _SHARES, _FLOOR_SIGMA), axis=0)
            prior = (log_scale / _PRIOR_LOG_SCALE_SIGMA) ** 2 + (shift_m / _PRIOR_SHIFT_SIGMA_M) ** 2
            score = float(weights @ np.log(density)) - 0.5 * prior
            if score > best:
                best, found = score, (math.exp(log_scale), float(shift_m))
    return found


def _solved(
    estimated_m: NDArray[np.float64], floor_m: NDArray[np.float64], weights: NDArray[np.float64], sigma: float
) -> tuple[float, float, NDArray[np.float64]]:
    """(scale, shift, their covariance): weighted least squares of the relative error at the floor, with the prior."""
    design = np.stack([estimated_m / floor_m, 1.0 / floor_m], axis=-1)
    prior = np.diag([_PRIOR_LOG_SCALE_SIGMA**-2, _PRIOR_SHIFT_SIGMA_M**-2])
    normal = (design * weights[:, None]).T @ design / sigma**2 + prior
    right = design.T @ weights / sigma**2 + prior @ (1.0, 0.0)
    scale, shift_m = np.linalg.solve(normal, right)
    return max(float(scale), 0.05), float(shift_m), np.asarray(np.linalg.inv(normal), np.float64)


def _is_plausible(
    is_floor: NDArray[np.bool_], floor_m: NDArray[np.float64], weights: NDArray[np.float64], sigmas: NDArray[np.float64]
) -> bool:
    """Whether what agrees with the plane is the floor. ``sigmas``: the residuals over the floor's standard deviation."""
    share, below, at_floor, before = (
        float(weights[which].sum() / weights.sum())
        for which in (
            is_floor,
            (sigmas > 0) & ~is_floor,
            np.abs(sigmas) < _PEAK_SIGMAS,
            np.abs(sigmas + 2 * _PEAK_SIGMAS) < _PEAK_SIGMAS,
        )
    )
    if is_floor.sum() < _MIN_SAMPLES or share < _MIN_SHARE:
        return False
    if below > max(_MAX_BELOW_SHARE, 0.5 * share) or at_floor < _MIN_PEAK * before:
        return False
    near_m, far_m = np.quantile(floor_m[is_floor], (0.05, 0.95))
    return share >= _SURE_SHARE or bool(far_m > _MIN_RANGE * near_m)


def _picture_sigma(residual: NDArray[np.float64], is_floor: NDArray[np.bool_], lengths: Sequence[int]) -> float:
    """Standard deviation of the pictures' own scales about the camera's."""
    ends = np.cumsum(lengths)[:-1]
    parts = zip(np.split(residual, ends), np.split(is_floor, ends), strict=True)
    scales = np.array([np.median(part[floor]) for part, floor in parts if floor.sum() >= _MIN_IN_PICTURE])
    total = _PICTURE_SIGMA_COUNTS * _PICTURE_SIGMA**2 + float(scales @ scales)
    return max(SCALE_SIGMA, math.sqrt(total / (_PICTURE_SIGMA_COUNTS + len(scales))))
