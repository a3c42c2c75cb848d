"""A camera's pose from points whose places are known: perspective-n-point with outliers, uncertainty and the planar ambiguity."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_pose.estimated_pose import EstimatedPose
from surveilnav.camera_pose.hypotheses import AGREES_D2, coplanarity_m, refined_on_all, refined_on_consensus
from surveilnav.camera_pose.refine import Observations, Refined, linearise, with_focal
from surveilnav.errors import PoseError
from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.geometry.lens import BrownConrady, Lens

MIN_POINTS = 4
#: A wrong click can be told from the others only if this many remain.
_MIN_AGREEING = 5
_MIN_AGREEING_SHARE = 0.6
#: Standard deviation of the position [m] from which a pose is of no use: searches need 0.05 m, and 0.1 m is worse than no camera.
_MAX_SIGMA_M = 0.5
#: Points whose distance from a line is a smaller share of their extent are on one line.
_MIN_WIDTH_SHARE = 0.03
#: Added to the squared distances of an upside-down camera: that it hangs so is possible, but has to be told by the clicks.
_UPSIDE_DOWN_D2 = 25.0
_MAX_UPRIGHT_TILT_RAD = math.radians(15.0)  # beyond straight down
#: A pose with squared distances larger by less than this is as good an explanation (likelihood ratio e^2).
_AS_GOOD_D2 = 4.0
_MIN_POINTS_HFOV = 6
_MIN_RELIEF_M = 0.1  # root mean square distance from a plane, for the field of view
_FOCAL_FACTORS = 2.0 ** np.linspace(-0.6, 0.6, 9)


@dataclass(frozen=True, eq=False)
class PoseFit(EstimatedPose):
    """A camera's pose from clicked points, with what tells how good it is.

    Attributes:
        residuals_px: (n, 2), clicked minus predicted pixel; NaN where the camera can't see the point.
        residuals_m: (n,), distance between the point and the ray of its pixel.
        inliers: (n,) bool, the points that the pose was fitted to; the others contradict it.
        hfov_rad: horizontal field of view; as given, or fitted.
        hfov_sigma_rad: its standard deviation; 0: not fitted.
        lens: with that field of view.
    """

    residuals_px: NDArray[np.float64]
    residuals_m: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    hfov_rad: float
    hfov_sigma_rad: float
    lens: Lens


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A local minimum.

    Attributes:
        agree: (n,) bool, the points that it was refined on.
        score: how badly it explains all points.
        sound: whether it explains the points that it was refined on, and these are enough to outvote the others.
    """

    fit: Refined
    agree: NDArray[np.bool_]
    score: float
    sound: bool
    above_floor: bool


def solve_pose(
    lens: Lens | Pinhole,
    points_px: NDArray[np.floating],
    p_world: NDArray[np.floating],
    sigma_px: float = 2.0,
    sigma_world_m: float = 0.02,
    fit_hfov: bool = False,
    floor_z_m: float = 0.0,
) -> PoseFit:
    """The pose of a camera that sees known points.

    If some points contradict the others, the pose is that of the largest group that agrees (``PoseFit.inliers``). Among several
    poses that explain the points, it is the one above the floor and upright, with the smaller residual. The result depends on
    nothing but the arguments.

    Args:
        lens: of the picture that was clicked in.
        points_px: (n, 2), (u, v) in that picture, distorted as it is.
        p_world: (n, 3), the points' places [m].
        sigma_px: standard deviation of u and of v.
        sigma_world_m: standard deviation of x and of y; of points off the floor also of z.
        fit_hfov: whether the horizontal field of view is fitted, too: the focal length is scaled, distortion stays.
        floor_z_m: altitude of the floor that the camera is above.

    Raises:
        PoseError: the points don't determine a pose, or contradict each other; the text says which to add or correct.
    """
    pixels, places = np.asarray(points_px, np.float64), np.asarray(p_world, np.float64)
    lens = BrownConrady(lens) if isinstance(lens, Pinhole) else lens
    _require_spread(lens, pixels, places, fit_hfov)
    off_floor = np.abs(places[:, 2] - floor_z_m) > 1e-6
    variance = np.stack([np.ones(len(places)), np.ones(len(places)), off_floor], axis=-1) * sigma_world_m**2
    origin = places.mean(axis=0)  # a building's coordinates may be large, such as those of a map grid
    seen = Observations(pixels, places - origin, sigma_px, variance)
    candidates = _candidates(lens, seen, fit_hfov, floor_z_m - origin[2])
    chosen = _chosen(candidates, seen, floor_z_m - origin[2])
    result = _result(chosen, seen, origin)
    _require_determined(result, pixels, chosen, candidates)
    return result


# --- before -------------------------------------------------------------------------------------------------------


def _require_spread(lens: Lens, pixels: NDArray, places: NDArray, fit_hfov: bool) -> None:
    n = len(pixels)
    if n < MIN_POINTS:
        raise PoseError(f"a pose needs at least {MIN_POINTS} points, and is good from 6 on; got {n}")
    if (
        pixels.shape != (n, 2)
        or places.shape != (n, 3)
        or not (np.isfinite(pixels).all() and np.isfinite(places).all())
    ):
        raise PoseError(f"expected finite pixels (n, 2) and places (n, 3), got {pixels.shape} and {places.shape}")
    size = np.array([lens.pinhole.width_px, lens.pinhole.height_px])
    for number, pixel in enumerate(pixels, start=1):
        if (pixel < -0.5).any() or (pixel > size - 0.5).any():
            raise PoseError(
                f"point {number} at ({pixel[0]:g}, {pixel[1]:g}) lies outside the picture of {size[0]} x {size[1]} pixels; "
                "click in a picture of the size that the camera's lens has in the file of cameras",
                [number],
            )
    for i in np.nonzero(np.isnan(lens.rays(pixels)).any(axis=1))[0]:
        raise PoseError(
            f"point {i + 1} lies where the lens sees nothing; check the lens, or leave the point out", [int(i) + 1]
        )
    extents = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    if extents[1] < _MIN_WIDTH_SHARE * max(extents[0], 1e-9):
        raise PoseError(
            "the points lie on one line, about which the camera could be turned anywhere; add points to both sides of it"
        )
    if fit_hfov and (n < _MIN_POINTS_HFOV or coplanarity_m(places) < _MIN_RELIEF_M):
        raise PoseError(
            f"to fit the field of view takes at least {_MIN_POINTS_HFOV} points, two of them well off the floor, such as "
            "the tops of doors; add some, or take the field of view from the data sheet"
        )


# --- choosing -----------------------------------------------------------------------------------------------------


def _candidates(lens: Lens, seen: Observations, fit_hfov: bool, floor_z_m: float) -> list[_Candidate]:
    """Minima from all points; if none of them explains the points, also those that most of the points agree on. Best first."""
    lenses = [with_focal(lens, float(factor)) for factor in _FOCAL_FACTORS] if fit_hfov else [lens]
    everyone = np.ones(len(seen), bool)
    found = [_candidate(fit, everyone, seen, floor_z_m) for fit in refined_on_all(lenses, seen, fit_hfov)]
    if len(seen) > MIN_POINTS and not any(c.sound and c.above_floor and _is_probable(c.fit) for c in found):
        some = refined_on_consensus(lenses, seen, fit_hfov)
        found += [_candidate(fit, agree, seen, floor_z_m) for fit, agree in some]
    return sorted(found, key=lambda c: (not c.sound, c.score))


def _candidate(fit: Refined, agree: NDArray[np.bool_], seen: Observations, floor_z_m: float) -> _Candidate:
    d2 = linearise(fit.lens, fit.T_world_camera, seen).squared_distances()
    upright = -fit.T_world_camera[2, 1] > -math.sin(_MAX_UPRIGHT_TILT_RAD)
    score = float(np.minimum(d2, 4 * AGREES_D2).sum()) + (0.0 if upright else _UPSIDE_DOWN_D2)
    n = len(seen)
    enough = agree.all() or agree.sum() >= max(_MIN_AGREEING, _MIN_AGREEING_SHARE * n)
    # Many small errors are no contradiction but enlarge the covariance. Four points have nothing to tell the two apart by.
    sound = bool(enough and (fit.d2 < AGREES_D2).all() and (n > MIN_POINTS or _is_probable(fit)))
    return _Candidate(fit, agree, score, sound, bool(fit.T_world_camera[2, 3] > floor_z_m))


def _is_probable(fit: Refined) -> bool:
    """Whether the squared distances are no larger than good clicks make them in 999 of 1000 cases (Wilson & Hilferty 1931)."""
    dof = 2 * len(fit.d2) - len(fit.covariance)
    return bool(fit.d2.sum() <= dof * (1 - 2 / (9 * dof) + 3.09 * math.sqrt(2 / (9 * dof))) ** 3)


def _chosen(candidates: list[_Candidate], seen: Observations, floor_z_m: float) -> _Candidate:
    if not candidates:
        raise PoseError(
            "no pose shows these points at these pixels: check the order of the points, and whether the lens has the right "
            "model and field of view"
        )
    best = candidates[0]
    if best.sound and not best.above_floor:
        twins = [c for c in candidates if c.sound and c.above_floor and c.score < best.score + _AS_GOOD_D2]
        if twins:
            return twins[0]
        below_m = floor_z_m - best.fit.T_world_camera[2, 3]
        raise PoseError(
            f"the points fit only a camera {below_m:.1f} m below the floor. Usually the plan's y axis points down where "
            "it should point up, left and right are swapped in the clicks, or heights are of another floor"
        )
    if not best.sound:
        raise _contradiction(next((c for c in candidates if c.above_floor), best), seen)
    return best


def _contradiction(best: _Candidate, seen: Observations) -> PoseError:
    T, lens = best.fit.T_world_camera, best.fit.lens
    off_px = np.linalg.norm(linearise(lens, T, seen).residuals_px, axis=1)
    off_px = np.where(np.isnan(off_px), np.inf, off_px)
    off_m = _ray_distances(lens, T, seen)
    worst = ([i for i in np.argsort(-off_px) if not best.agree[i]] or list(np.argsort(-off_px)))[:3]
    named = [
        f"point {i + 1} is {off_px[i]:.0f} px ({100 * off_m[i]:.0f} cm) off"
        if np.isfinite(off_px[i])
        else f"point {i + 1} would be out of sight"
        for i in worst
    ]
    return PoseError(
        f"the points contradict each other: by the best pose, {', '.join(named)}. Check where these were clicked and where "
        "they are in the building, check the lens, or add points so that wrong ones can be told from right ones",
        [int(i) + 1 for i in worst],
    )


# --- after --------------------------------------------------------------------------------------------------------


def _result(chosen: _Candidate, seen: Observations, origin: NDArray[np.float64]) -> PoseFit:
    fit = chosen.fit
    n_params = len(fit.covariance)
    dof = 2 * len(fit.d2) - n_params
    inflation = max(1.0, float(fit.d2.sum()) / dof) if dof > 0 else 1.0
    covariance = fit.covariance * inflation
    T_world_camera = fit.T_world_camera.copy()
    T_world_camera[:3, 3] += origin
    hfov_rad = fit.lens.hfov_rad
    sigma_rad = 0.0
    if n_params == 7:  # by the logarithm of the focal length
        sigma_rad = abs(with_focal(fit.lens, 1.001).hfov_rad - hfov_rad) / 0.001 * math.sqrt(covariance[6, 6])
    return PoseFit(
        T_world_camera,
        covariance[:6, :6],
        linearise(fit.lens, fit.T_world_camera, seen).residuals_px,
        _ray_distances(fit.lens, fit.T_world_camera, seen),
        chosen.agree,
        hfov_rad,
        sigma_rad,
        fit.lens,
    )


def _require_determined(result: PoseFit, pixels: NDArray, chosen: _Candidate, candidates: list[_Candidate]) -> None:
    sigma_m = result.position_sigma_m
    if not sigma_m < _MAX_SIGMA_M:
        pinhole = result.lens.pinhole
        share = cv2.contourArea(cv2.convexHull(pixels.astype(np.float32))) / (pinhole.width_px * pinhole.height_px)
        raise PoseError(
            f"the points leave the camera's position uncertain by ±{sigma_m:.1f} m: they cover {100 * share:.1f} % of the "
            "picture. Add points that are far apart in the picture, near and far, and at different heights"
        )
    for other in candidates:
        apart_m = float(np.linalg.norm(other.fit.T_world_camera[:3, 3] - chosen.fit.T_world_camera[:3, 3]))
        if other.above_floor and other.score < chosen.score + _AS_GOOD_D2 and apart_m > max(0.2, 3 * sigma_m):
            raise PoseError(
                f"two poses {apart_m:.1f} m apart explain the points equally well, because all of them lie in one plane or "
                "close together. Add a point at another height, such as the top of a door"
            )


def _ray_distances(lens: Lens, T_world_camera: Matrix4, seen: Observations) -> NDArray[np.float64]:
    """(n,): distance [m] of each point from the ray of its pixel; to the camera where it lies behind."""
    rays_world = lens.rays(seen.pixels) @ T_world_camera[:3, :3].T
    offset = seen.p_world - T_world_camera[:3, 3]
    along = np.maximum(0.0, np.einsum("ni,ni->n", offset, rays_world))
    return np.asarray(np.linalg.norm(offset - along[:, None] * rays_world, axis=1))
