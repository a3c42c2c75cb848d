"""Depth by a network of others, such as Depth Anything V2: fitted to the floor that the camera sees, and with an uncertainty."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import PerceptionError
from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.perception.depth.estimate import FLOOR_CHANCE, MAX_SIGMA_LOG, DepthEstimate, MetricDepthModel
from surveilnav.perception.depth.floor_scale import FloorSamples, FloorScale, fit_floor_scale
from surveilnav.perception.depth.reference import FARTHEST_M, Reference, reference_depth

#: Uncertainty of the logarithm of depth beside the floor. An assumption, not a measurement: no weights were at hand.
OFF_FLOOR_SIGMA = 0.1
#: The fit is made of the newest pictures, and made anew with each.
_PICTURES = 32
_SAMPLES_ACROSS = 32
#: After so many pictures without enough floor, this is said.
_PATIENCE = 20


class FittedDepth:
    """A ``DepthEstimator`` for one camera. Until a fit is found, no depth is known.

    Args:
        model: the network.
        report: gets one line when the floor is found, and one if it isn't for long.
    """

    def __init__(self, model: MetricDepthModel, report: Callable[[str], None] = lambda _: None) -> None:
        self._model, self._report = model, report
        self._pictures: deque[FloorSamples] = deque(maxlen=_PICTURES)
        self._fit: FloorScale | None = None
        self._n_without = 0
        self._lock = threading.Lock()

    @property
    def fit(self) -> FloorScale | None:
        """Scale and shift as they were fitted last; None before the floor was found."""
        return self._fit

    def estimate(
        self, rgb: NDArray[np.uint8], camera: Pinhole, T_world_camera: Matrix4, floor_z_m: float
    ) -> DepthEstimate:
        """See ``DepthEstimator.estimate``."""
        height, width = camera.height_px, camera.width_px
        if rgb.shape != (height, width, 3) or rgb.dtype != np.uint8:
            raise PerceptionError(
                f"expected a picture (H, W, 3) uint8 of its camera's {width} x {height} pixels, got {rgb.shape} {rgb.dtype}"
            )
        reference = reference_depth(camera, T_world_camera, floor_z_m)
        estimated_m = np.nan_to_num(self._model.depth_m(rgb), nan=0.0, posinf=0.0, neginf=0.0)
        estimated_m[~rgb.any(axis=-1)] = 0.0  # beyond the lens, and in privacy zones
        with self._lock:
            self._refine(_samples(estimated_m, reference))
            fit = self._fit
        return _unknown(estimated_m) if fit is None else _corrected(estimated_m, reference, fit)

    def _refine(self, samples: FloorSamples) -> None:
        self._pictures.append(samples)
        fit = fit_floor_scale(self._pictures)
        if fit is None:
            self._n_without += 1
            if self._n_without == _PATIENCE and self._fit is None:
                self._report(
                    f"its estimated depth isn't used: in {_PATIENCE} pictures, too little of the floor was found to fit it to. "
                    "Check its pose and its lens (`surveilnav cameras calibrate`), and that it sees the floor"
                )
            return
        if self._fit is None:
            self._report(
                f"its estimated depth fits the floor after x {fit.scale:.2f} and {fit.shift_m:+.2f} m, give or take "
                f"{100 * fit.floor_sigma:.0f} %; the fit goes on"
            )
        self._fit = fit


def _samples(estimated_m: NDArray[np.float32], reference: Reference) -> FloorSamples:
    step = max(1, round(estimated_m.shape[1] / _SAMPLES_ACROSS))
    estimated, floor_m = estimated_m[::step, ::step], reference.depth_m[::step, ::step]
    there = (estimated > 0) & reference.floor[::step, ::step]
    return FloorSamples(estimated[there].astype(np.float64), floor_m[there].astype(np.float64))


def _unknown(estimated_m: NDArray[np.float32]) -> DepthEstimate:
    nothing = np.zeros_like(estimated_m)
    return DepthEstimate(nothing, np.full_like(estimated_m, MAX_SIGMA_LOG), nothing)


def _corrected(estimated_m: NDArray[np.float32], reference: Reference, fit: FloorScale) -> DepthEstimate:
    depth_m = fit.apply(estimated_m)
    floor_m = np.where(reference.floor, reference.depth_m, np.inf)
    on_floor = fit.floor_chance(depth_m, floor_m).astype(np.float32)
    # The larger of both: where the network is bad on the floor, it isn't better elsewhere.
    sigma = np.hypot(max(OFF_FLOOR_SIGMA, fit.floor_sigma), fit.fit_sigma(estimated_m)).astype(np.float32)
    depth_m = np.where(on_floor > FLOOR_CHANCE, reference.depth_m, depth_m)
    depth_m[(sigma > MAX_SIGMA_LOG) | (depth_m > FARTHEST_M)] = 0.0
    return DepthEstimate(depth_m.astype(np.float32), sigma, on_floor, fit.picture_sigma)
