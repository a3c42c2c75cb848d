"""What cameras, the tag's place on the robot and the robot's poses predict for every sighting, with derivatives.

A corner of the tag is seen at the pixel of ``T_camera_world T_world_robot T_robot_tag p_tag``. Unknown are the pose of each
camera (6), the tag's place on the robot (x, y and a rotation: 5) and the robot's pose at each stop (x, y, yaw: 3). What the robot
says of its pose is a measurement of it.

The tag's height above the floor isn't among the unknowns: a robot moves in a plane, so tag and cameras could all be higher or
lower by the same length and every picture would stay the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_pose.tag.detection import tag_corners
from surveilnav.geometry import Matrix4
from surveilnav.geometry.lens import Lens

_Array = NDArray[np.float64]
_STEP_SHARE = 1e-6  # of a point's distance, for derivatives of the lens
CAMERA_DOF, TAG_DOF, STOP_DOF = 6, 5, 3


@dataclass(frozen=True, eq=False)
class Observations:
    """All sightings of the tag that count.

    Attributes:
        lenses: of each camera.
        camera: (n,) int, which camera made a sighting.
        stop: (n,) int, at which stop.
        corners_px: (n, 4, 2).
        stops: (m, 3), x [m], y [m] and yaw [rad] of the robot at each stop, as it said.
        floor_z_m: (m,), altitude of the floor that it stood on.
        size_m, height_m: of the tag's black square, and its centre above the floor.
        sigma_px: standard deviation of u and of v of a corner.
        sigma_stop: those of ``stops``.
    """

    lenses: tuple[Lens, ...]
    camera: NDArray[np.intp]
    stop: NDArray[np.intp]
    corners_px: _Array
    stops: _Array
    floor_z_m: _Array
    size_m: float
    height_m: float
    sigma_px: float = 0.5
    sigma_stop: tuple[float, float, float] = (0.02, 0.02, math.radians(1.0))

    def __len__(self) -> int:
        return len(self.camera)

    def __getitem__(self, chosen: NDArray) -> Observations:
        """Some of the sightings, by index or by mask. Cameras and stops keep their numbers."""
        return replace(self, camera=self.camera[chosen], stop=self.stop[chosen], corners_px=self.corners_px[chosen])

    def of_camera(self, camera: int) -> Observations:
        """Those of one camera, which becomes number 0."""
        own = self[self.camera == camera]
        return replace(own, lenses=(self.lenses[camera],), camera=np.zeros(len(own), np.intp))

    def loosened(self, factor: float) -> Observations:
        """With larger errors, for a start that is far off."""
        x, y, yaw = (factor * sigma for sigma in self.sigma_stop)
        return replace(self, sigma_px=self.sigma_px * factor, sigma_stop=(x, y, yaw))

    def robot_poses(self, stops: _Array) -> _Array:
        """``T_world_robot`` (m, 4, 4) at stops (m, 3)."""
        T = np.tile(np.eye(4), (len(stops), 1, 1))
        c, s = np.cos(stops[:, 2]), np.sin(stops[:, 2])
        T[:, 0, 0], T[:, 0, 1], T[:, 1, 0], T[:, 1, 1] = c, -s, s, c
        T[:, :2, 3], T[:, 2, 3] = stops[:, :2], self.floor_z_m
        return T


@dataclass(frozen=True, eq=False)
class State:
    """Values of the unknowns.

    Attributes:
        T_world_camera: (c, 4, 4).
        T_robot_tag: (4, 4), its z as ``Observations.height_m``.
        stops: (m, 3), as ``Observations.stops``.
    """

    T_world_camera: _Array
    T_robot_tag: Matrix4
    stops: _Array

    def moved(self, change: _Array) -> State:
        """After a change of all unknowns: cameras, tag, stops. Rotations [rad] turn about the axes of world and robot."""
        c = len(self.T_world_camera)
        cameras, tag, stops = np.split(change, [CAMERA_DOF * c, CAMERA_DOF * c + TAG_DOF])
        T_world_camera = self.T_world_camera.copy()
        for T, (position, rotation) in zip(T_world_camera, cameras.reshape(c, 2, 3), strict=True):
            T[:3, 3] += position
            T[:3, :3] = _rotation(rotation) @ T[:3, :3]
        T_robot_tag = self.T_robot_tag.copy()
        T_robot_tag[:2, 3] += tag[:2]
        T_robot_tag[:3, :3] = _rotation(tag[2:]) @ T_robot_tag[:3, :3]
        return State(T_world_camera, T_robot_tag, self.stops + stops.reshape(-1, STOP_DOF))


@dataclass(frozen=True, eq=False)
class Linearised:
    """Residuals and derivatives in units of ``sigma_px``.

    Attributes:
        residuals: (n, 8), seen minus predicted; NaN where the camera can't see a corner.
        by_camera, by_tag, by_stop: (n, 8, 6 or 5 or 3), derivatives of the prediction.
    """

    residuals: _Array
    by_camera: _Array
    by_tag: _Array
    by_stop: _Array

    @property
    def visible(self) -> NDArray[np.bool_]:
        """(n,): the sightings that the cameras can have made."""
        return np.asarray(np.isfinite(self.residuals).all(axis=1))


def linearise(state: State, seen: Observations) -> Linearised:
    """Residuals and derivatives of all sightings at a state."""
    n = len(seen)
    T_world_robot = seen.robot_poses(state.stops)[seen.stop]
    arm_robot = tag_corners(seen.size_m) @ state.T_robot_tag[:3, :3].T  # (4, 3), from the tag's centre
    p_robot = arm_robot + state.T_robot_tag[:3, 3]
    R_world_robot = T_world_robot[:, None, :3, :3]
    offset_robot = p_robot @ T_world_robot[:, :3, :3].transpose(0, 2, 1)  # (n, 4, 3) in the world's axes
    p_world = offset_robot + T_world_robot[:, None, :3, 3]
    predicted = np.full((n, 4, 2), np.nan)
    by_world = np.full((n, 4, 2, 3), np.nan)
    offset = np.full((n, 4, 3), np.nan)
    for camera, lens in enumerate(seen.lenses):
        own = seen.camera == camera
        T = state.T_world_camera[camera]
        offset[own] = p_world[own] - T[:3, 3]
        predicted[own], by_world[own] = _pixels(lens, T[:3, :3], offset[own])
    by_camera = np.concatenate([-by_world, by_world @ _cross_matrices(offset)], axis=-1)
    by_robot = by_world @ R_world_robot
    by_tag = np.concatenate([by_robot[..., :2], -by_robot @ _cross_matrices(arm_robot)], axis=-1)
    turned = np.stack([-offset_robot[..., 1], offset_robot[..., 0], np.zeros((n, 4))], axis=-1)
    by_yaw = np.einsum("nkij,nkj->nki", by_world, turned)[..., None]
    by_stop = np.concatenate([by_world[..., :2], by_yaw], axis=-1)
    residuals = (seen.corners_px - predicted) / seen.sigma_px
    return Linearised(
        residuals.reshape(n, 8), *(J.reshape(n, 8, J.shape[-1]) / seen.sigma_px for J in (by_camera, by_tag, by_stop))
    )


def squared_distances(state: State, seen: Observations) -> _Array:
    """(n,): squared Mahalanobis distance of each sighting from its prediction, if the robot is where it said.

    It has 8 degrees of freedom. The covariance is ``I + J diag(sigma_stop^2) J^T`` in units of ``sigma_px``. Infinite where the
    camera can't see the tag.
    """
    at = linearise(replace(state, stops=seen.stops), seen)
    d2 = np.full(len(seen), np.inf)
    J, r = at.by_stop[at.visible], at.residuals[at.visible]
    S = np.eye(8) + np.einsum("nia,a,nja->nij", J, np.square(seen.sigma_stop), J)
    d2[at.visible] = np.einsum("ni,ni->n", r, np.linalg.solve(S, r[..., None])[..., 0])
    return d2


def _pixels(lens: Lens, R_world_camera: _Array, offset: _Array) -> tuple[_Array, _Array]:
    """Pixels (..., 2) of points at ``offset`` (..., 3) from the camera in the world's axes, and their derivatives (..., 2, 3)."""
    p_camera = offset @ R_world_camera
    step = _STEP_SHARE * np.maximum(1e-3, np.linalg.norm(p_camera, axis=-1))[..., None]
    probes = np.stack([p_camera, *(p_camera + side * step * e for e in np.eye(3) for side in (1, -1))])
    pixels = lens.pixels(probes)
    by_camera = np.stack([pixels[1 + 2 * i] - pixels[2 + 2 * i] for i in range(3)], axis=-1) / (2 * step[..., None])
    return pixels[0], by_camera @ R_world_camera.T


def _rotation(vector: _Array) -> _Array:
    return np.asarray(cv2.Rodrigues(np.ascontiguousarray(vector))[0])


def _cross_matrices(v: _Array) -> _Array:
    """(..., 3, 3), each of which maps w to v x w."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out
