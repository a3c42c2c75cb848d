"""Poses that could be the camera's, from all points at once or from samples of four (RANSAC, Fischler & Bolles 1981)."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from itertools import combinations
from math import comb

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_pose.refine import Observations, Refined, linearise, refine
from surveilnav.geometry import Matrix4, inverse
from surveilnav.geometry.lens import Lens

#: Squared Mahalanobis distance up to which a point agrees with a pose. 4 sigma; of good clicks 1 in 3000 is beyond it.
AGREES_D2 = 16.0
#: The same for a pose from four points only, which is itself uncertain.
_AGREES_ROUGHLY_D2 = 36.0
_MAX_SAMPLES = 150
_SAMPLE = 4
_REFINED = 4  # hypotheses that are refined, the best ones
_MIN_RAY_Z = 0.05  # PnP works on the plane at depth 1: rays 87 degrees and more from the axis can't be used
_SEED = 20_250_101


def poses_from(lens: Lens, seen: Observations) -> list[Matrix4]:
    """Candidates of ``T_world_camera`` that explain all points in the sense of least squares.

    Solvers: SQPNP (Terzakis & Lourakis 2020); for points in one plane also IPPE (Collins & Bartoli 2014), which returns
    both poses of the planar ambiguity; for three points P3P.
    """
    rays = lens.rays(seen.pixels)
    usable = rays[:, 2] > _MIN_RAY_Z
    if usable.sum() < min(_SAMPLE, len(seen)):
        return []
    p_world, xy = seen.p_world[usable], np.ascontiguousarray(rays[usable, :2] / rays[usable, 2:])
    centre = p_world.mean(axis=0)
    found = []
    for rotation, translation in _solutions(p_world - centre, xy):
        T_camera_world = np.eye(4)
        T_camera_world[:3, :3], T_camera_world[:3, 3] = cv2.Rodrigues(rotation)[0], translation[:, 0]
        if np.isfinite(T_camera_world).all():
            T_world_camera = inverse(T_camera_world)
            T_world_camera[:3, 3] += centre
            found.append(T_world_camera)
    return found


def _solutions(points: NDArray[np.float64], xy: NDArray[np.float64]) -> Iterator[tuple[NDArray, NDArray]]:
    """Rotation vectors (3, 1) and translations (3, 1) of ``T_camera_world``, for points (n, 3) at ``xy`` (n, 2) at depth 1."""
    K = np.eye(3)
    with contextlib.suppress(cv2.error):  # a degenerate sample
        if len(points) == 3:
            yield from zip(*cv2.solveP3P(points, xy, K, None, flags=cv2.SOLVEPNP_P3P)[1:3], strict=True)
            return
        yield from zip(*cv2.solvePnPGeneric(points, xy, K, None, flags=cv2.SOLVEPNP_SQPNP)[1:3], strict=True)
        if coplanarity_m(points) < 1e-3:
            yield from zip(*cv2.solvePnPGeneric(points, xy, K, None, flags=cv2.SOLVEPNP_IPPE)[1:3], strict=True)


def refined_on_all(lenses: list[Lens], seen: Observations, fit_focal: bool) -> list[Refined]:
    """The minima that are reached from every pose that explains all points; of four points, also those that explain three."""
    triples = [np.array(t) for t in combinations(range(len(seen)), 3)] if len(seen) == _SAMPLE else []
    samples = [seen, *(seen[triple] for triple in triples)]
    starts = [(lens, T) for lens in lenses for sample in samples for T in poses_from(lens, sample)]
    return [fit for lens, T in starts if (fit := refine(lens, T, seen, fit_focal))]


def refined_on_consensus(lenses: list[Lens], seen: Observations, fit_focal: bool) -> list[tuple[Refined, NDArray]]:
    """Poses that most points agree on, each with the (n,) bool of the points that it was refined on; best first."""
    rough: list[tuple[float, int, Lens, Matrix4]] = []
    for sample in _samples(len(seen)):
        for lens in lenses:
            for T in poses_from(lens, seen[sample]):
                d2 = linearise(lens, T, seen).squared_distances()
                rough.append((float(np.minimum(d2, _AGREES_ROUGHLY_D2).sum()), len(rough), lens, T))
    found = []
    for _, _, lens, T in sorted(rough, key=lambda r: r[:2])[:_REFINED]:
        if fit := _refined_on_inliers(lens, T, seen, fit_focal):
            found.append(fit)
    return found


def _refined_on_inliers(
    lens: Lens, T: Matrix4, seen: Observations, fit_focal: bool
) -> tuple[Refined, NDArray[np.bool_]] | None:
    """Refines on the points that agree, and asks again which do, until the same ones agree."""
    agree = linearise(lens, T, seen).squared_distances() < _AGREES_ROUGHLY_D2
    fit = None
    for _ in range(8):
        fit = refine(lens, T, seen[agree], fit_focal) if agree.sum() >= _SAMPLE else None
        if fit is None:
            return None
        again = linearise(fit.lens, fit.T_world_camera, seen).squared_distances() < AGREES_D2
        lens, T = fit.lens, fit.T_world_camera
        if (again == agree).all():
            break
        agree = again
    return (fit, agree) if fit is not None and len(fit.d2) == agree.sum() else None


def coplanarity_m(p_world: NDArray[np.floating]) -> float:
    """Root mean square distance [m] of points (n, 3) from the plane that fits them best."""
    return float(np.linalg.svd(p_world - p_world.mean(axis=0), compute_uv=False)[-1] / np.sqrt(len(p_world)))


def _samples(n: int) -> Iterator[NDArray[np.intp]]:
    """All samples of four among n points, or that many of them, always the same ones."""
    if comb(n, _SAMPLE) <= _MAX_SAMPLES:
        yield from (np.array(sample) for sample in combinations(range(n), _SAMPLE))
        return
    rng = np.random.default_rng(_SEED)
    for _ in range(_MAX_SAMPLES):
        yield rng.choice(n, _SAMPLE, replace=False)
