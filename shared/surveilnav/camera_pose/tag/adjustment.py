"""Bundle adjustment: cameras, tag and stops together, until the corners lie where they were seen and the robot where it said.

Levenberg-Marquardt on the sum over sightings and stops of a Cauchy loss, by iteratively reweighted least squares (Triggs et al.
2000). A sighting or a stop that contradicts the others thus loses its weight as a whole.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_pose.tag.model import CAMERA_DOF, STOP_DOF, TAG_DOF, Linearised, Observations, State, linearise

_Array = NDArray[np.float64]
_MAX_STEPS = 60
_CONVERGED = 1e-7  # m and rad
#: Squared distances from which the Cauchy loss bends: of 8 coordinates of corners, and of a stop's 3.
_SIGHTING_D2, _STOP_D2 = 16.0, 6.0
#: Singular values below this share of the largest are zero: nothing determines this combination of unknowns.
_RANK = 1e-7


@dataclass(frozen=True, eq=False)
class Adjusted:
    """A local minimum.

    Attributes:
        cost: the sum of the losses, about the sum of squared distances where the sightings agree.
    """

    state: State
    cost: float


def adjust(state: State, seen: Observations, robust: bool) -> Adjusted | None:
    """The nearest minimum. None: from this state a camera can't see one of its sightings.

    Args:
        robust: whether a sighting or a stop far off loses weight; else all count as they are.
    """
    damping, at = 1e-3, linearise(state, seen)
    if not at.visible.all():
        return None
    cost = _cost(at, state, seen, robust)
    for _ in range(_MAX_STEPS):
        J, r = _system(at, state, seen, robust)
        H, g = J.T @ J, J.T @ r
        scale = np.diag(H) + 1e-9 * max(1.0, float(np.diag(H).max()))
        change = np.linalg.solve(H + damping * np.diag(scale), g)
        new = state.moved(np.asarray(change, np.float64))
        new_at = linearise(new, seen)
        new_cost = _cost(new_at, new, seen, robust) if new_at.visible.all() else math.inf
        small = float(np.abs(change).max()) < _CONVERGED
        if new_cost <= cost:
            state, at, cost, damping = new, new_at, new_cost, max(1e-12, damping * 0.2)
        else:
            damping *= 10.0
        if small or damping > 1e9:
            break
    return Adjusted(state, cost)


def singular_values(state: State, seen: Observations) -> tuple[_Array, _Array]:
    """Of the derivatives of all residuals by all unknowns: singular values (p,), falling, and right singular vectors (p, p).

    The vectors are rows. Unknowns are in metres and radians, in the order of ``State.moved``; residuals in standard deviations.
    """
    J, _ = _system(linearise(state, seen), state, seen, robust=False)
    _, s, V = np.linalg.svd(J, full_matrices=True)
    return np.concatenate([s, np.zeros(len(V) - len(s))]), V


def nullity(singular: _Array) -> int:
    """How many combinations of unknowns nothing determines."""
    return int((singular <= _RANK * singular[0]).sum())


def covariance(state: State, seen: Observations) -> _Array:
    """(p, p), of all unknowns in the order of ``State.moved``; infinite if something isn't determined."""
    s, V = singular_values(state, seen)
    if nullity(s):
        return np.full((len(s), len(s)), np.inf)
    return (V.T / s**2) @ V


def _blocks(at: Linearised, state: State, seen: Observations) -> tuple[_Array, _Array]:
    """Squared distances of the sightings (n,), and of the stops (m,) from where the robot said it was."""
    moved = (seen.stops - state.stops) / seen.sigma_stop
    return np.square(at.residuals).sum(axis=1), np.square(moved).sum(axis=1)


def _cost(at: Linearised, state: State, seen: Observations, robust: bool) -> float:
    of_sightings, of_stops = _blocks(at, state, seen)
    if not robust:
        return float(of_sightings.sum() + of_stops.sum())
    return float(
        _SIGHTING_D2 * np.log1p(of_sightings / _SIGHTING_D2).sum() + _STOP_D2 * np.log1p(of_stops / _STOP_D2).sum()
    )


def _system(at: Linearised, state: State, seen: Observations, robust: bool) -> tuple[_Array, _Array]:
    """The weighted derivatives (8 n + 3 m, p) and residuals (8 n + 3 m,)."""
    n, c, m = len(seen), len(seen.lenses), len(seen.stops)
    of_sightings, of_stops = _blocks(at, state, seen)
    w = 1 / np.sqrt(1 + of_sightings / _SIGHTING_D2) if robust else np.ones(n)
    w_stop = 1 / np.sqrt(1 + of_stops / _STOP_D2) if robust else np.ones(m)
    tag, stops = CAMERA_DOF * c, CAMERA_DOF * c + TAG_DOF
    J = np.zeros((8 * n + STOP_DOF * m, stops + STOP_DOF * m))
    rows = 8 * np.arange(n)[:, None, None] + np.arange(8)[:, None]
    J[rows, CAMERA_DOF * seen.camera[:, None, None] + np.arange(CAMERA_DOF)] = w[:, None, None] * at.by_camera
    J[: 8 * n, tag:stops] = (w[:, None, None] * at.by_tag).reshape(8 * n, TAG_DOF)
    J[rows, stops + STOP_DOF * seen.stop[:, None, None] + np.arange(STOP_DOF)] = w[:, None, None] * at.by_stop
    prior = w_stop[:, None] / np.array(seen.sigma_stop)
    J[8 * n + np.arange(STOP_DOF * m), stops + np.arange(STOP_DOF * m)] = prior.ravel()
    r = np.concatenate([(w[:, None] * at.residuals).ravel(), (prior * (seen.stops - state.stops)).ravel()])
    return J, r
