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

# mypy: allow-untyped-defs, allow-untyped-calls, no-check-untyped-defs
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simulator.render.shading import in_bands
from surveilnav.geometry import Pinhole


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
    def none(cls) -> DepthNoise:
        """Clean depth."""
        return cls()

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
            _apply, depth_m.shape[0], np.ascontiguousarray(depth_m), out, camera.fx_px, camera.fy_px, camera.cx_px,
            camera.cy_px, np.uint64(seed & 0xFFFFFFFFFFFFFFFF), self.lateral_px, self.axial_m, self.axial_per_m,
            self.axial_z0_m, self.disparity_step, self.grazing_cos, self.dropout,
        )  # fmt: skip
        return out


@njit(nogil=True, cache=True, inline="always")
def _mix(x):
    """SplitMix64's finaliser (Steele, Lea, Flood 2014): a good 64-bit hash."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@njit(nogil=True, cache=True, inline="always")
def _normal(bits):
    """About N(0, 1) from 64 random bits: the sum of four 16-bit uniforms (Irwin-Hall), tails end at 3.46 sigma."""
    mask = np.uint64(0xFFFF)
    total = np.float64(bits & mask) + np.float64((bits >> np.uint64(16)) & mask)
    total += np.float64((bits >> np.uint64(32)) & mask) + np.float64(bits >> np.uint64(48))
    return (total / 65535.0 - 2.0) * 1.7320508


@njit(nogil=True, cache=True)
def _apply(row0, row1, depth, out, fx, fy, cx, cy, seed, lateral, axial, per_m, z0, step, grazing, dropout):
    height, width = depth.shape
    golden = np.uint64(0x9E3779B97F4A7C15)
    key = _mix(seed + golden)
    for row in range(row0, row1):
        y = (row - cy) / fy
        for col in range(width):
            bits = _mix(key + np.uint64(row * width + col + 1) * golden)
            r, c = row, col
            if lateral > 0.0:
                jitter = _mix(bits + golden)
                r += int(np.floor(_normal(jitter) * lateral + 0.5))
                c += int(np.floor(_normal(_mix(jitter + golden)) * lateral + 0.5))
                r, c = min(max(r, 0), height - 1), min(max(c, 0), width - 1)
            z = depth[r, c]
            if not (z > 0.0):
                out[row, col] = 0.0
                continue
            # Neighbouring pixels on one smooth surface differ little; across an edge jitter really swaps surfaces,
            # but on a slanted plane it would only double the axial noise: keep the plane's own depth there.
            own = depth[row, col]
            if own > 0.0 and abs(own - z) < 0.05 * own:
                z = own
            uniform = np.float64(_mix(bits + golden + golden) >> np.uint64(11)) / 9007199254740992.0
            if uniform < dropout:
                out[row, col] = 0.0
                continue
            if grazing > 0.0 and 0 < r < height - 1 and 0 < c < width - 1:
                # For a plane n.p = d the inverse depth is linear in the image: its slope gives the normal.
                wl, wr, wu, wd = depth[r, c - 1], depth[r, c + 1], depth[r - 1, c], depth[r + 1, c]
                if wl > 0.0 and wr > 0.0 and wu > 0.0 and wd > 0.0:
                    w = 1.0 / depth[r, c]
                    gx = 0.5 * (1.0 / wr - 1.0 / wl) * fx
                    gy = 0.5 * (1.0 / wd - 1.0 / wu) * fy
                    x = (c - cx) / fx
                    nz = w - gx * x - gy * ((r - cy) / fy)
                    # Only where the surface is one plane: an edge's slope says nothing about an angle.
                    flat = abs(1.0 / wr + 1.0 / wl - 2.0 * w) + abs(1.0 / wd + 1.0 / wu - 2.0 * w) < 0.02 * w
                    ray = np.sqrt(x * x + y * y + 1.0)
                    cosine = w / (np.sqrt(gx * gx + gy * gy + nz * nz) * ray + 1e-12)
                    if flat and cosine < grazing:
                        out[row, col] = 0.0
                        continue
            z = z + _normal(bits) * (axial + per_m * (z - z0) * (z - z0))
            if step > 0.0 and z > 0.0:
                disparity = np.floor(1.0 / (z * step) + 0.5) * step
                z = 1.0 / disparity if disparity > 0.0 else 0.0
            out[row, col] = max(z, 0.0)
