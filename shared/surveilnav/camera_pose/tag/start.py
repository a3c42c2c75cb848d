"""Where cameras and tag could be, from single sightings: a start for the adjustment that neither ambiguity nor outliers mislead.

One sighting gives the tag's pose in the camera's frame twice: tilted towards the camera or away from it, a small square looks
almost the same (IPPE, Collins & Bartoli 2014). Its distance and direction are good, though. So the camera's rotation is guessed:
the line between two sightings has to fit the line between the robot's two places, and the angle about that line is tried in
steps. All other sightings then tell which guess is right, because they have to agree on how the tag is mounted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_pose.tag.adjustment import Adjusted, adjust
from surveilnav.camera_pose.tag.detection import tag_corners
from surveilnav.camera_pose.tag.model import Observations, State, squared_distances
from surveilnav.geometry import Matrix4, inverse
from surveilnav.geometry.lens import Lens

_Array = NDArray[np.float64]
_MAX_SIGHTINGS = 24  # that guesses are judged by
_MAX_PAIRS = 12
_ANGLES = 36  # about the line between two sightings
_REFINED = 5
_ALIKE = math.cos(math.radians(12.0))
_OFF_M, _OFF_RAD = 0.4, 0.4  # at which a sighting counts as contradicting a guess; a tag sits off the robot's centre
_UPSIDE_DOWN = 1.0  # what an upside-down camera costs, in sightings
#: Errors of the first adjustment, in those of the last.
_LOOSENED = (20.0, 4.0)
#: At which a sighting's squared distance counts as contradicting.
CLIPPED_D2 = 100.0


@dataclass(frozen=True, eq=False)
class TagPoses:
    """Where each sighting (n,) puts the tag in its camera's frame: two rotations (n, 2, 3, 3) and translations (n, 2, 3)."""

    R_camera_tag: _Array
    p_camera: _Array

    @classmethod
    def from_sightings(cls, seen: Observations) -> TagPoses:
        """Of all sightings."""
        found = [
            _tag_poses(seen.lenses[camera], corners, seen.size_m)
            for camera, corners in zip(seen.camera, seen.corners_px, strict=True)
        ]
        return cls(np.array([R for R, _ in found]), np.array([p for _, p in found]))


def first_state(seen: Observations) -> Adjusted | None:
    """The state that explains the sightings of a single camera best; None: there is none that shows them."""
    found = []
    for T_world_camera, R_robot_tag in _guesses(seen):
        T_robot_tag = np.eye(4)
        T_robot_tag[:3, :3], T_robot_tag[2, 3] = R_robot_tag, seen.height_m
        if fit := settled(State(T_world_camera[None], T_robot_tag, seen.stops), seen):
            found.append(fit)
    return min(found, key=lambda fit: fit.cost, default=None)


def settled(state: State, seen: Observations) -> Adjusted | None:
    """The minimum that is reached from a state that is far off: with large errors first, then with the true ones."""
    for factor in _LOOSENED:
        fit = adjust(state, seen.loosened(factor), robust=True)
        if fit is None:
            return None
        state = State(fit.state.T_world_camera, fit.state.T_robot_tag, seen.stops)
    return adjust(state, seen, robust=True)


def camera_from_tag(seen: Observations, T_robot_tag: Matrix4) -> Matrix4 | None:
    """``T_world_camera`` of a single camera by the sighting that agrees best with its others, the tag's place being known."""
    poses = TagPoses.from_sightings(seen)
    T_world_robot = seen.robot_poses(seen.stops)[seen.stop]
    best, best_cost = None, math.inf
    for T, rotations, places in zip(T_world_robot, poses.R_camera_tag, poses.p_camera, strict=True):
        for R, p in zip(rotations, places, strict=True):
            T_camera_tag = np.eye(4)
            T_camera_tag[:3, :3], T_camera_tag[:3, 3] = R, p
            T_world_camera = T @ T_robot_tag @ inverse(T_camera_tag)
            state = State(T_world_camera[None], T_robot_tag, seen.stops)
            # From one sighting the others are far off: large errors, as in the adjustment that follows.
            cost = np.minimum(squared_distances(state, seen.loosened(_LOOSENED[0])), CLIPPED_D2).sum()
            if cost < best_cost:
                best, best_cost = T_world_camera, float(cost)
    return best


def _guesses(seen: Observations) -> Iterator[tuple[Matrix4, _Array]]:
    """``T_world_camera`` and R_robot_tag of the guesses for a single camera that most sightings agree with; best first."""
    chosen = np.unique(np.linspace(0, len(seen) - 1, _MAX_SIGHTINGS).round().astype(int))
    seen = seen[chosen]
    poses = TagPoses.from_sightings(seen)
    T_world_robot = seen.robot_poses(seen.stops)[seen.stop]
    p_world = T_world_robot[:, :3, 3] + [0.0, 0.0, seen.height_m]
    ranked: list[tuple[float, Matrix4, _Array]] = []
    for R in _camera_rotations(poses.p_camera[:, 0], p_world):
        away = p_world - poses.p_camera[:, 0] @ R.T
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R, np.median(away, axis=0)
        off_m = np.linalg.norm(away - T[:3, 3], axis=1)
        turns, R_robot_tag = mounting(R, T_world_robot[:, :3, :3], poses.R_camera_tag)
        cost = np.minimum(1, (off_m / _OFF_M) ** 2).sum() + turns
        cost += _UPSIDE_DOWN if R[2, 1] > 0.3 else 0.0
        if T[2, 3] > seen.floor_z_m[seen.stop].min():
            ranked.append((float(cost), T, R_robot_tag))
    taken: list[Matrix4] = []
    for _, T, R_robot_tag in sorted(ranked, key=lambda guess: guess[0]):
        if all((np.trace(T[:3, :3].T @ other[:3, :3]) - 1) / 2 < _ALIKE for other in taken):
            taken.append(T)
            yield T, R_robot_tag
        if len(taken) == _REFINED:
            return


def _camera_rotations(p_camera: _Array, p_world: _Array) -> Iterator[_Array]:
    """Rotations (3, 3) from the camera's frame to the world's that fit the line between two sightings, far apart ones first."""
    pairs = sorted(
        combinations(range(len(p_world)), 2), key=lambda ij: -float(np.linalg.norm(p_world[ij[0]] - p_world[ij[1]]))
    )
    for i, j in pairs[:: max(1, len(pairs) // (2 * _MAX_PAIRS))][:_MAX_PAIRS]:
        a, b = p_camera[j] - p_camera[i], p_world[j] - p_world[i]
        if min(np.linalg.norm(a), np.linalg.norm(b)) < 1e-6:
            continue
        onto, axis = _frame(b), _frame(a)
        for angle in np.arange(_ANGLES) * (2 * math.pi / _ANGLES):
            c, s = math.cos(angle), math.sin(angle)
            yield onto @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]) @ axis.T


def _frame(x: _Array) -> _Array:
    """A rotation (3, 3) whose first column points along ``x``."""
    x = x / np.linalg.norm(x)
    y = np.cross(np.eye(3)[np.argmin(np.abs(x))], x)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def mounting(R_world_camera: _Array, R_world_robot: _Array, R_camera_tag: _Array) -> tuple[float, _Array]:
    """R_robot_tag that most sightings agree on, and how many don't.

    Args:
        R_camera_tag: (n, 2, 3, 3), of which one of each pair is right.
    """
    R_robot_tag = np.einsum("nji,jk,nakl->nail", R_world_robot, R_world_camera, R_camera_tag)
    every = R_robot_tag.reshape(-1, 3, 3)
    traces = np.einsum("aij,nbij->anb", every, R_robot_tag)
    angles = np.arccos(np.clip((traces - 1) / 2, -1.0, 1.0)).min(axis=2)
    costs = np.minimum(1, (angles / _OFF_RAD) ** 2).sum(axis=1)
    best = int(np.argmin(costs))
    return float(costs[best]), every[best]


def _tag_poses(lens: Lens, corners_px: _Array, size_m: float) -> tuple[_Array, _Array]:
    """Both poses of the tag in the camera's frame: rotations (2, 3, 3), translations (2, 3). NaN: the lens sees nothing there.

    The rays are first turned so that the tag is straight ahead: a fisheye also sees what is beside it, and the plane at depth 1
    isn't there.
    """
    rays = lens.rays(corners_px)
    nothing = np.full((2, 3, 3), np.nan), np.full((2, 3), np.nan)
    if not np.isfinite(rays).all():
        return nothing
    ahead = _frame(rays.mean(axis=0))[:, [1, 2, 0]]  # columns: the axes of a camera that looks at the tag
    turned = rays @ ahead
    xy = np.ascontiguousarray(turned[:, :2] / turned[:, 2:])
    try:
        n, rotations, translations, _ = cv2.solvePnPGeneric(
            tag_corners(size_m), xy, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
    except cv2.error:
        return nothing
    if not n:
        return nothing
    R = [ahead @ cv2.Rodrigues(rotation)[0] for rotation in rotations]
    p = [ahead @ translation[:, 0] for translation in translations]
    return np.array([R[0], R[-1]]), np.array([p[0], p[-1]])
