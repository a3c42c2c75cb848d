"""Fits a plane to the floor that a camera with a depth sensor sees: a camera that leans, or hangs higher than it says, shows it.

The floor is the largest nearly level plane with hardly anything below it. One view may take a bed for the floor, so a plane
alone proves nothing; planes of several views of one camera that agree do (``quarantine``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.sensing.views import PosedView

_CELLS = 64  # samples across a picture
_MIN_POINTS = 200
_NEAR_M, _FAR_M = 0.3, 10.0
_HYPOTHESES = 150
#: A plane is looked for up to this tilt and this difference of height.
_MAX_TILT_RAD, _MAX_HEIGHT_ERROR_M = math.radians(15.0), 0.8
#: A point belongs to a plane within this, plus a share of its distance.
_TOLERANCE_M, _TOLERANCE = 0.03, 0.015
_REFINEMENTS = 3


@dataclass(frozen=True, slots=True)
class FloorPlane:
    """The floor as one view shows it, beside the floor that the description of its camera says.

    Attributes:
        tilt_x_rad, tilt_y_rad: how much the seen floor rises along the world's x and y.
        height_error_m: how much too high above its floor the camera is described.
        share: the share of the view's points that belong to the seen floor.
        described_share: the share of its points that belong to the described floor.
        spread_m: how far the points on the plane extend in their narrower direction (standard deviation).
    """

    tilt_x_rad: float
    tilt_y_rad: float
    height_error_m: float
    share: float
    described_share: float
    spread_m: float

    @property
    def tilt_rad(self) -> float:
        return math.hypot(self.tilt_x_rad, self.tilt_y_rad)


def fit_floor_plane(view: PosedView) -> FloorPlane | None:
    """The floor that a view shows; None if it shows none. The same view gives the same plane."""
    p = _points(view)  # from the camera, along the world's axes
    if len(p) < _MIN_POINTS:
        return None
    height_m = view.mounting_offset_m
    level_m = np.linalg.norm(p[:, :2], axis=1)
    possible = np.abs(p[:, 2] + height_m) < _MAX_HEIGHT_ERROR_M + level_m * math.tan(_MAX_TILT_RAD)
    candidates = p[possible]
    if len(candidates) < _MIN_POINTS // 2:
        return None
    tolerance_m = _TOLERANCE_M + _TOLERANCE * np.linalg.norm(p, axis=1)
    best = _best_hypothesis(p, candidates, tolerance_m, possible, height_m)
    if best is None:
        return None
    up, above_m = best
    spread_m = 0.0
    for _ in range(_REFINEMENTS):
        distance = (candidates @ up + above_m) / tolerance_m[possible]
        is_on = np.abs(distance) < 1.0
        on_plane, weights = candidates[is_on], (1.0 - distance[is_on] ** 2) ** 2  # Tukey's: feet of walls count little
        if len(on_plane) < _MIN_POINTS // 2:
            return None
        middle = np.average(on_plane, axis=0, weights=weights)
        _, widths, axes = np.linalg.svd((on_plane - middle) * np.sqrt(weights)[:, None], full_matrices=False)
        up = axes[2] * np.sign(axes[2, 2])
        above_m, spread_m = -float(up @ middle), float(widths[1]) / math.sqrt(weights.sum())
    on_described = np.abs(p[:, 2] + height_m) < tolerance_m
    return FloorPlane(
        tilt_x_rad=-float(up[0] / up[2]),
        tilt_y_rad=-float(up[1] / up[2]),
        height_error_m=height_m - float(above_m / up[2]),
        share=len(on_plane) / len(p),
        described_share=float(on_described.mean()),
        spread_m=spread_m,
    )


def _points(view: PosedView) -> NDArray[np.float64]:
    """A sample (N, 3) of a view's points [m], from the camera, along the world's axes."""
    step = max(1, view.camera.width_px // _CELLS)
    depth_m = view.depth_m[::step, ::step]
    there = (depth_m > _NEAR_M) & (depth_m < _FAR_M)
    rays = view.camera.rays()[::step, ::step][there]
    return np.asarray((rays * depth_m[there][:, None]) @ view.T_world_camera[:3, :3].T, np.float64)


def _best_hypothesis(
    p: NDArray[np.float64],
    candidates: NDArray[np.float64],
    tolerance_m: NDArray[np.float64],
    possible: NDArray[np.bool_],
    height_m: float,
) -> tuple[NDArray[np.float64], float] | None:
    """The plane through three candidates with most points on it, less those below it (RANSAC, Fischler and Bolles 1981).

    Returns:
        Its upward normal (3,) and how far the camera is above it [m]; None if no plane is level enough.
    """
    chosen = candidates[np.random.default_rng(0).integers(0, len(candidates), (_HYPOTHESES, 3))]
    normal = np.cross(chosen[:, 1] - chosen[:, 0], chosen[:, 2] - chosen[:, 0])
    length = np.linalg.norm(normal, axis=1)
    wide = length > 1e-3
    up = normal[wide] / length[wide, None] * np.sign(normal[wide, 2:3])
    above_m = -(up * chosen[wide, 0]).sum(axis=1)
    level = up[:, 2] > math.cos(_MAX_TILT_RAD)
    up, above_m = up[level], above_m[level]
    near = np.abs(above_m / up[:, 2] - height_m) < _MAX_HEIGHT_ERROR_M
    up, above_m = up[near], above_m[near]
    if not len(up):
        return None
    distance_m = p @ up.T + above_m
    n_on = (np.abs(distance_m) < tolerance_m[:, None])[possible].sum(axis=0)
    n_below = (distance_m < -2.0 * tolerance_m[:, None]).sum(axis=0)
    k = int(np.argmax(n_on - n_below))
    return up[k], float(above_m[k])
