"""An estimated depth with its uncertainty, and the interface of what estimates it from a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.messages import DepthUncertainty

#: A pixel with a higher chance of showing the floor gets the floor's depth.
FLOOR_CHANCE = 0.5
#: Beyond this uncertainty, depth is unknown.
MAX_SIGMA_LOG = 0.6
#: Depth that is more uncertain than this isn't put into maps.
MAX_MAPPED_SIGMA_LOG = 0.3
#: A scale that comes from the pose is as wrong as a height of 2 m that was measured to 5 cm.
SCALE_SIGMA = 0.03


@dataclass(frozen=True, slots=True, eq=False)
class DepthEstimate:
    """The depth of one picture.

    Attributes:
        depth_m: (H, W) float32 [m] along the optical axis, 0 where it is unknown.
        sigma_log: (H, W) float32, uncertainty of the logarithm of depth: 68 in 100 errors are smaller (0.1: 10 %).
        floor: (H, W) float32, the chance that a pixel shows the floor. Where it is above 0.5, depth is the floor's.
        scale_sigma: standard deviation of the logarithm of a factor that all depths of the picture have in common.
    """

    depth_m: NDArray[np.float32]
    sigma_log: NDArray[np.float32]
    floor: NDArray[np.float32]
    scale_sigma: float = SCALE_SIGMA

    def for_maps(self) -> tuple[NDArray[np.float32], DepthUncertainty]:
        """(depth (H, W) [m], 0 where it is too uncertain to be mapped; how uncertain the rest is beside the floor)."""
        used = (self.depth_m > 0) & (self.sigma_log <= MAX_MAPPED_SIGMA_LOG)
        things = self.sigma_log[used & (self.floor <= FLOOR_CHANCE)]
        sigma = float(np.median(things)) if things.size else MAX_MAPPED_SIGMA_LOG
        return np.where(used, self.depth_m, np.float32(0.0)), DepthUncertainty(sigma, self.scale_sigma)


class DepthEstimator(Protocol):
    """Estimates the depth of one camera's pictures; safe to use from several threads."""

    def estimate(
        self, rgb: NDArray[np.uint8], camera: Pinhole, T_world_camera: Matrix4, floor_z_m: float
    ) -> DepthEstimate:
        """The depth of a picture.

        Args:
            rgb: (H, W, 3) uint8, without distortion of the lens; black where there is no picture.
            camera: intrinsics of the picture.
            T_world_camera: (4, 4) pose of the camera [m]; the world's z points up.
            floor_z_m: height in the world of the floor that the camera looks at [m].

        Raises:
            PerceptionError: the picture isn't of the camera's size, or the camera isn't above the floor.
        """
        ...


class MetricDepthModel(Protocol):
    """A network for any camera: from a picture to metres, without knowing where the camera hangs."""

    def depth_m(self, rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
        """(H, W) float32 [m] along the optical axis, of a picture (H, W, 3) uint8; 0 or not finite: unknown."""
        ...
