"""A camera's pose as people write it: yaw, pitch and roll."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4, camera_pose

#: Nearer than this to straight down or up, only the direction of the picture's top is a yaw.
_VERTICAL_RAD = 1e-4
_STEP_RAD = 1e-6


def yaw_pitch_roll(T_world_camera: Matrix4) -> tuple[float, float, float]:
    """Yaw, pitch and roll [rad] of ``T_world_camera`` (4, 4): the inverse of ``CameraEntry.pose``.

    Yaw turns anticlockwise from +x, pitch is positive when it looks up, and roll turns the camera clockwise about its
    axis. A camera that looks straight down has the yaw of its picture's top, and no roll.
    """
    forward, up = T_world_camera[:3, 2], -T_world_camera[:3, 1]
    across = math.hypot(forward[0], forward[1])
    pitch_rad = math.atan2(forward[2], across)
    if across < _VERTICAL_RAD:
        top = up if forward[2] < 0 else -up
        return math.atan2(top[1], top[0]), math.copysign(math.pi / 2, pitch_rad), 0.0
    yaw_rad = math.atan2(forward[1], forward[0])
    level = camera_pose((0.0, 0.0, 0.0), yaw_rad, pitch_rad)[:3, :3]
    R_level_camera = level.T @ T_world_camera[:3, :3]
    return yaw_rad, pitch_rad, math.atan2(R_level_camera[1, 0], R_level_camera[0, 0])


def angle_sigmas(T_world_camera: Matrix4, covariance: NDArray[np.float64]) -> tuple[float, float, float]:
    """Standard deviations [rad] of yaw, pitch and roll.

    Near straight down, yaw and roll turn the picture in the same way: then each alone is uncertain, however certain their sum is.

    Args:
        covariance: (3, 3) of a small rotation [rad] about the world's axes.
    """
    J = np.empty((3, 3))
    for axis, step in enumerate(np.eye(3) * _STEP_RAD):
        angles = []
        for rotation in (step, -step):
            turned = T_world_camera.copy()
            turned[:3, :3] = cv2.Rodrigues(rotation)[0] @ T_world_camera[:3, :3]
            angles.append(yaw_pitch_roll(turned))
        change = np.array(angles[0]) - np.array(angles[1])
        J[:, axis] = (change + math.pi) % (2 * math.pi) - math.pi
    J /= 2 * _STEP_RAD
    yaw, pitch, roll = np.sqrt(np.einsum("ij,jk,ik->i", J, covariance, J))
    return float(yaw), float(pitch), float(roll)
