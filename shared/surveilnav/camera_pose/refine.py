"""Refines a camera's pose until the points lie where they were clicked: weighted least squares by Levenberg-Marquardt.

Two things are uncertain: where in the picture somebody clicked, and where in the building the point is. The nearer the
point, the more pixels the second one makes. So each point is weighted by the covariance of its pixel,
``S = sigma_px^2 I + J diag(variance) J^T`` with the derivative J of the pixel by the point (Hartley & Zisserman 2004, 5.2).
The pose's covariance follows from those of the points.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4
from surveilnav.geometry.lens import Lens

_Array = NDArray[np.float64]
_MAX_STEPS = 40
_STEP_SHARE = 1e-6  # of a point's distance, for derivatives of the lens
_MIN_VARIANCE = 1e-12
_CONVERGED = 1e-7  # m and rad


@dataclass(frozen=True, eq=False)
class Observations:
    """Points that were clicked.

    Attributes:
        pixels: (n, 2).
        p_world: (n, 3).
        sigma_px: standard deviation of u and of v.
        variance_m2: (n, 3), of x, y, z of ``p_world``.
    """

    pixels: _Array
    p_world: _Array
    sigma_px: float
    variance_m2: _Array

    def __len__(self) -> int:
        return len(self.pixels)

    def __getitem__(self, chosen: NDArray) -> Observations:
        """Some of the points, by index or by mask."""
        return replace(
            self, pixels=self.pixels[chosen], p_world=self.p_world[chosen], variance_m2=self.variance_m2[chosen]
        )


@dataclass(frozen=True, eq=False)
class Linearised:
    """What a pose says about each point.

    Attributes:
        residuals_px: (n, 2), clicked minus predicted; NaN where the camera can't see the point.
        J: (n, 2, 7), derivative of the predicted pixel by position [m] and rotation [rad], both in the world's axes, and by the
            logarithm of the focal length.
        S: (n, 2, 2), covariance of the residuals.
    """

    residuals_px: _Array
    J: _Array
    S: _Array

    def squared_distances(self) -> _Array:
        """(n,): squared Mahalanobis distance of each point; infinite where the camera can't see it."""
        seen = np.asarray(np.isfinite(self.residuals_px).all(axis=1) & np.isfinite(self.S).all(axis=(1, 2)))
        d2 = np.full(len(seen), np.inf)
        r = self.residuals_px[seen]
        d2[seen] = np.einsum("ni,ni->n", r, np.linalg.solve(self.S[seen], r[..., None])[..., 0])
        return d2


@dataclass(frozen=True, eq=False)
class Refined:
    """A pose in a local minimum.

    Attributes:
        covariance: (6, 6) or (7, 7), in the order of ``Linearised.J``; infinite if the points don't determine the pose.
        d2: (n,), squared Mahalanobis distances of the points that it was refined on.
    """

    T_world_camera: Matrix4
    lens: Lens
    covariance: _Array
    d2: _Array


def linearise(lens: Lens, T_world_camera: Matrix4, seen: Observations) -> Linearised:
    """Residuals, derivatives and weights of all points at a pose."""
    R, offset = T_world_camera[:3, :3], seen.p_world - T_world_camera[:3, 3]
    p_camera = offset @ R
    step = _STEP_SHARE * np.maximum(1e-3, np.linalg.norm(p_camera, axis=1))
    probes = np.concatenate(
        [[np.zeros((len(seen), 3))], [side * step[:, None] * e for e in np.eye(3) for side in (1, -1)]]
    )
    pixels = lens.pixels(p_camera + probes)
    by_camera = np.stack([pixels[1 + 2 * i] - pixels[2 + 2 * i] for i in range(3)], axis=-1) / (2 * step[:, None, None])
    by_world = by_camera @ R.T
    centre = np.array([lens.pinhole.cx_px, lens.pinhole.cy_px])
    by_rotation = by_world @ _cross_matrices(offset)
    J = np.concatenate([-by_world, by_rotation, (pixels[0] - centre)[..., None]], axis=-1)
    S = np.einsum("nik,nk,njk->nij", by_world, seen.variance_m2, by_world)
    return Linearised(seen.pixels - pixels[0], J, S + max(seen.sigma_px**2, _MIN_VARIANCE) * np.eye(2))


def refine(lens: Lens, T_world_camera: Matrix4, seen: Observations, fit_focal: bool = False) -> Refined | None:
    """The nearest minimum of the points' squared distances; None: from this pose the camera can't see all of them."""
    n = 7 if fit_focal else 6
    T, damping = T_world_camera, 1e-3
    at = linearise(lens, T, seen)
    if not np.isfinite(at.squared_distances()).all():
        return None
    for _ in range(_MAX_STEPS):
        weights = np.linalg.inv(at.S)
        H = np.einsum("nia,nij,njb->ab", at.J[..., :n], weights, at.J[..., :n])
        g = np.einsum("nia,nij,nj->a", at.J[..., :n], weights, at.residuals_px)
        cost = _cost(at.residuals_px, weights)
        change = np.linalg.lstsq(H + damping * np.diag(np.diag(H)), g, rcond=None)[0]
        new_lens, new_T = _moved(lens, T, change)
        new = linearise(new_lens, new_T, seen)
        if not (np.isfinite(new.squared_distances()).all() and _cost(new.residuals_px, weights) <= cost):
            damping *= 10.0
            if damping > 1e9 or np.abs(change).max() < _CONVERGED:
                break
            continue
        lens, T, at, damping = new_lens, new_T, new, damping * 0.2
        if np.abs(change).max() < _CONVERGED:
            break
    return Refined(T, lens, _covariance(at, n), at.squared_distances())


def _cost(residuals_px: _Array, weights: NDArray[np.floating]) -> float:
    return float(np.einsum("ni,nij,nj->", residuals_px, weights, residuals_px))


def _covariance(at: Linearised, n: int) -> _Array:
    H = np.einsum("nia,nij,njb->ab", at.J[..., :n], np.linalg.inv(at.S), at.J[..., :n])
    try:
        covariance = np.linalg.inv(H)
    except np.linalg.LinAlgError:
        return np.full((n, n), np.inf)
    return covariance if (np.diag(covariance) > 0).all() else np.full((n, n), np.inf)


def _moved(lens: Lens, T: Matrix4, change: _Array) -> tuple[Lens, Matrix4]:
    moved = T.copy()
    moved[:3, 3] += change[:3]
    moved[:3, :3] = cv2.Rodrigues(np.ascontiguousarray(change[3:6]))[0] @ T[:3, :3]
    return (with_focal(lens, math.exp(min(1.0, max(-1.0, change[6])))) if len(change) > 6 else lens), moved


def with_focal(lens: Lens, factor: float) -> Lens:
    """The lens with another focal length."""
    pinhole = replace(lens.pinhole, fx_px=lens.pinhole.fx_px * factor, fy_px=lens.pinhole.fy_px * factor)
    return replace(lens, pinhole=pinhole)


def _cross_matrices(v: _Array) -> _Array:
    """(n, 3, 3), each of which maps w to v x w."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]
    return out
