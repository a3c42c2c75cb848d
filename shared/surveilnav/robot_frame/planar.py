"""A rigid transform of the plane, SE(2): a turn about the vertical, then a shift."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surveilnav.geometry import Matrix4, base_pose, yaw_of


@dataclass(frozen=True, slots=True)
class PlanarTransform:
    """``T_a_b``: maps places in frame b to frame a. Also the pose of b in a. The default changes nothing.

    Attributes:
        x_m, y_m: where b's origin lies in a.
        yaw_rad: b's x axis in a, anticlockwise; from -pi to pi.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (self.x_m, self.y_m, self.yaw_rad))):
            raise ValueError(f"a planar transform must be finite, got {self.x_m}, {self.y_m}, {self.yaw_rad}")
        object.__setattr__(self, "yaw_rad", math.remainder(self.yaw_rad, 2 * math.pi))

    @classmethod
    def from_matrix(cls, T_a_b: Matrix4) -> PlanarTransform:
        """The part in the plane of a (4, 4) rigid transform."""
        return cls(float(T_a_b[0, 3]), float(T_a_b[1, 3]), yaw_of(T_a_b))

    def matrix(self, z_m: float = 0.0) -> Matrix4:
        """(4, 4); ``z_m``: altitude of b's plane in a, such as the floor's."""
        return base_pose((self.x_m, self.y_m, z_m), self.yaw_rad)

    def rotation(self) -> NDArray[np.float64]:
        """(2, 2)."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return np.array([[c, -s], [s, c]])

    def apply(self, p_b: ArrayLike) -> NDArray[np.float64]:
        """Places (..., 2) of frame b in frame a [m]."""
        p = np.asarray(p_b, np.float64)
        return np.asarray(p @ self.rotation().T + (self.x_m, self.y_m))

    def inverse(self) -> PlanarTransform:
        """``T_b_a``."""
        x, y = -(self.rotation().T @ (self.x_m, self.y_m))
        return PlanarTransform(float(x), float(y), -self.yaw_rad)

    def __matmul__(self, other: PlanarTransform) -> PlanarTransform:
        """``T_a_c = T_a_b @ T_b_c``."""
        x, y = self.apply((other.x_m, other.y_m))
        return PlanarTransform(float(x), float(y), self.yaw_rad + other.yaw_rad)

    def difference(self, other: PlanarTransform, p_b: ArrayLike = (0.0, 0.0)) -> tuple[float, float]:
        """By how much two transforms of b differ: distance [m] at a place of b (2,), and angle [rad], both >= 0."""
        off = self.apply(p_b) - other.apply(p_b)
        return float(np.hypot(*off)), abs(math.remainder(self.yaw_rad - other.yaw_rad, 2 * math.pi))
