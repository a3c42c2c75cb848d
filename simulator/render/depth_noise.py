"""A noise model for depth cameras: what a simulated RGB-D sensor does to clean depth.

Four effects, in this order:

1. lateral jitter: a pixel shows the depth of a neighbour, with sigma ``lateral_px`` (Nguyen, Izadi, Lovell 2012,
   "Modeling Kinect sensor noise for improved 3D reconstruction and tracking", sec. 3.2: 0.8-0.9 px);
2. axial noise: sigma = ``axial_m + axial_per_m * (z - axial_z0_m)**2`` (the same, eq. 3: 0.0012 + 0.0019 (z - 0.4)^2
   for a Kinect; the growth with z^2 is Khoshelham & Elberink 2012, "Accuracy and resolution of Kinect depth data",
   eq. 10);
3. quantisation in disparity: 1/z in steps of ``disparity_step`` [1/m] (Khoshelham & Elberink: depth steps grow with
   z^2, 7 cm at 5 m, which is 0.0028 / m);
4. dropout: no depth where the surface is seen at a grazing angle (estimated from the depth image itself) and,
   with a small probability, anywhere.

Every pixel's randomness is a hash of its index and the seed: the same seed gives the same bytes on any number of
threads.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole
from surveilnav.simulator.render.bands import in_bands
from surveilnav.simulator.render.hashed import add_noise


@dataclass(frozen=True, slots=True)
class DepthNoise:
    """Strength of each effect; see the module. Zeros switch an effect off."""

    lateral_px: float = 0.0
    axial_m: float = 0.0
    axial_per_m: float = 0.0
    axial_z0_m: float = 0.4
    disparity_step: float = 0.0
    grazing_cos: float = 0.0
    dropout: float = 0.0

    @classmethod
    def robot(cls) -> DepthNoise:
        """A structured light or active stereo sensor on a robot (0.5-5 m): Nguyen's Kinect figures."""
        return cls(0.8, 0.0012, 0.0019, 0.4, 0.0028, 0.10, 0.001)

    @classmethod
    def camera(cls) -> DepthNoise:
        """A wide surveillance RGB-D camera (to 20 m): longer baseline, so a smaller growth with distance."""
        return cls(0.8, 0.002, 0.0008, 0.4, 0.0015, 0.10, 0.002)

    def apply(self, depth_m: NDArray[np.float32], camera: Pinhole, seed: int) -> NDArray[np.float32]:
        """Noisy copy of ``depth_m`` (H, W) float32 [m], 0 where there is none; deterministic in ``seed``."""
        if self == DepthNoise():
            return depth_m.copy()
        out = np.empty_like(depth_m)
        in_bands(
            add_noise,
            depth_m.shape[0],
            np.ascontiguousarray(depth_m),
            out,
            camera.fx_px,
            camera.fy_px,
            camera.cx_px,
            camera.cy_px,
            np.uint64(seed & 0xFFFFFFFFFFFFFFFF),
            self.lateral_px,
            self.axial_m,
            self.axial_per_m,
            self.axial_z0_m,
            self.disparity_step,
            self.grazing_cos,
            self.dropout,
        )
        return out
