"""A camera's pose and how certain it is, however it was found."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4


@dataclass(frozen=True, eq=False)
class EstimatedPose:
    """A pose with its uncertainty.

    Attributes:
        T_world_camera: (4, 4), OpenCV axes.
        covariance: (6, 6) of the position [m] and of a small rotation [rad] about the world's axes.
            Larger than the assumed errors imply if what was observed fits worse.
    """

    T_world_camera: Matrix4
    covariance: NDArray[np.float64]

    @property
    def position_sigma_m(self) -> float:
        """Standard deviation of the position: the root of the summed variances of x, y and z."""
        return math.sqrt(np.trace(self.covariance[:3, :3]))

    @property
    def angle_sigma_rad(self) -> float:
        """Standard deviation of the direction: the root of the summed variances about three axes."""
        return math.sqrt(np.trace(self.covariance[3:, 3:]))
