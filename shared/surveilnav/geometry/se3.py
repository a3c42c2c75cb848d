"""Rigid transforms in three dimensions.

``T_a_b`` is a (4, 4) float64 matrix that maps homogeneous points of frame ``b`` to frame ``a``, so
neighbours cancel: ``T_world_object = T_world_camera @ T_camera_object``. The world is right-handed,
z up, in metres; cameras follow OpenCV (x right, y down, z forward).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Matrix4 = NDArray[np.float64]

#: Columns are the axes of a level OpenCV camera that looks along +x of the world.
_R_WORLD_LEVEL_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True, slots=True)
class Pose:
    """A rigid transform as it travels on the wire.

    ``translation_m`` is (x, y, z) in metres, ``quaternion_xyzw`` a unit quaternion (x, y, z, w).
    """

    translation_m: tuple[float, float, float]
    quaternion_xyzw: tuple[float, float, float, float]

    def __post_init__(self) -> None:
        values = (*self.translation_m, *self.quaternion_xyzw)
        if not all(math.isfinite(v) for v in values):
            raise ValueError(f"a pose must be finite, got {values}")
        norm = math.sqrt(sum(q * q for q in self.quaternion_xyzw))
        if abs(norm - 1.0) > 1e-3:
            raise ValueError(f"a pose needs a unit quaternion, got one of norm {norm:.4f}")

    @classmethod
    def from_matrix(cls, T: ArrayLike) -> Pose:
        """The pose of a (4, 4) rigid transform."""
        T = np.asarray(T, dtype=np.float64)
        x, y, z = (float(v) for v in T[:3, 3])
        return cls((x, y, z), _quaternion_xyzw(T[:3, :3]))

    def matrix(self) -> Matrix4:
        """The (4, 4) float64 matrix of this pose."""
        x, y, z, w = np.asarray(self.quaternion_xyzw) / np.linalg.norm(self.quaternion_xyzw)
        T = np.eye(4)
        T[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        T[:3, 3] = self.translation_m
        return T


def _quaternion_xyzw(R: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Unit quaternion of a (3, 3) rotation matrix, by the largest component (Shepperd 1978)."""
    trace = float(np.trace(R))
    candidates = np.array([R[0, 0], R[1, 1], R[2, 2], trace])
    largest = int(np.argmax(candidates))
    if largest == 3:
        q = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 1 + trace])
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q = np.empty(4)
        q[i] = 1 - trace + 2 * R[i, i]
        q[j] = R[j, i] + R[i, j]
        q[k] = R[k, i] + R[i, k]
        q[3] = R[k, j] - R[j, k]
    x, y, z, w = (float(v) for v in q / np.linalg.norm(q))
    return x, y, z, w


def inverse(T_a_b: Matrix4) -> Matrix4:
    """``T_b_a`` of a rigid ``T_a_b`` (4, 4)."""
    T_b_a = np.eye(4)
    R_b_a = T_a_b[:3, :3].T
    T_b_a[:3, :3] = R_b_a
    T_b_a[:3, 3] = -R_b_a @ T_a_b[:3, 3]
    return T_b_a


def transform_points(T_a_b: Matrix4, p_b: NDArray[np.floating]) -> NDArray[np.floating]:
    """Maps points ``p_b`` (..., 3) of frame b to frame a; keeps the dtype of ``p_b``."""
    R = T_a_b[:3, :3].astype(p_b.dtype)
    return p_b @ R.T + T_a_b[:3, 3].astype(p_b.dtype)


def camera_pose(position_m: ArrayLike, yaw_rad: float, pitch_rad: float) -> Matrix4:
    """``T_world_camera`` of an OpenCV camera at ``position_m`` (3,).

    ``yaw_rad`` turns anticlockwise from +x of the world; ``pitch_rad`` > 0 looks up. No roll. The top
    of a camera that looks straight down (pitch -pi/2) points along its yaw.
    """
    cy, sy, cp, sp = math.cos(yaw_rad), math.sin(yaw_rad), math.cos(pitch_rad), math.sin(pitch_rad)
    R_yaw = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    R_pitch = np.array([[cp, 0.0, -sp], [0.0, 1.0, 0.0], [sp, 0.0, cp]])
    T = np.eye(4)
    T[:3, :3] = R_yaw @ R_pitch @ _R_WORLD_LEVEL_CAMERA
    T[:3, 3] = np.asarray(position_m, dtype=np.float64)
    return T


def base_pose(position_m: ArrayLike, yaw_rad: float) -> Matrix4:
    """``T_world_base`` of a robot base on the floor: x forward, y left, z up."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    T = np.eye(4)
    T[:3, :3] = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
    T[:3, 3] = np.asarray(position_m, dtype=np.float64)
    return T


def yaw_of(T_world_x: Matrix4) -> float:
    """Yaw in radians of the x axis of a base frame."""
    return math.atan2(T_world_x[1, 0], T_world_x[0, 0])
