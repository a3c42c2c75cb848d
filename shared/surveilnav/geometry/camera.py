"""The pinhole camera: pixels, rays and depth.

OpenCV's convention throughout: x right, y down, z forward; pixel (0, 0) is the centre of the top left
pixel; depth is the z coordinate in the camera frame, not the length of the ray.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Pinhole:
    """Intrinsics of an undistorted camera, in pixels."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float

    def __post_init__(self) -> None:
        if not (1 <= self.width_px <= 16384 and 1 <= self.height_px <= 16384):
            raise ValueError(f"an image is 1 to 16384 pixels wide and high, got {self.width_px}x{self.height_px}")
        if not (math.isfinite(self.fx_px) and math.isfinite(self.fy_px) and self.fx_px > 0 and self.fy_px > 0):
            raise ValueError(f"focal lengths must be positive and finite, got {self.fx_px}, {self.fy_px}")
        if not (math.isfinite(self.cx_px) and math.isfinite(self.cy_px)):
            raise ValueError(f"the principal point must be finite, got {self.cx_px}, {self.cy_px}")

    @classmethod
    def from_hfov(cls, width_px: int, height_px: int, hfov_rad: float) -> Pinhole:
        """Square pixels, centred, with the horizontal field of view ``hfov_rad``."""
        f_px = width_px / (2.0 * math.tan(hfov_rad / 2.0))
        return cls(width_px, height_px, f_px, f_px, (width_px - 1) / 2.0, (height_px - 1) / 2.0)

    @property
    def hfov_rad(self) -> float:
        return 2.0 * math.atan(self.width_px / (2.0 * self.fx_px))

    def resized(self, width_px: int, height_px: int) -> Pinhole:
        """The same camera at another resolution (pixel centres stay centred)."""
        sx, sy = width_px / self.width_px, height_px / self.height_px
        return Pinhole(
            width_px,
            height_px,
            self.fx_px * sx,
            self.fy_px * sy,
            (self.cx_px + 0.5) * sx - 0.5,
            (self.cy_px + 0.5) * sy - 0.5,
        )

    def rays(self) -> NDArray[np.float32]:
        """Rays (height, width, 3) float32 in the camera frame, each with z = 1. Shared: don't write to it."""
        return _rays(self)

    def back_project(self, depth_m: NDArray[np.floating]) -> NDArray[np.float32]:
        """Points (height, width, 3) float32 in the camera frame of a depth image (height, width) [m]."""
        return self.rays() * depth_m[..., None].astype(np.float32, copy=False)

    def project(self, p_camera: NDArray[np.floating]) -> NDArray[np.floating]:
        """Pixels (..., 2) as (u, v) of points (..., 3) in the camera frame; NaN where z <= 0."""
        z = p_camera[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            u = self.fx_px * p_camera[..., 0] / z + self.cx_px
            v = self.fy_px * p_camera[..., 1] / z + self.cy_px
        uv = np.stack([u, v], axis=-1)
        uv[z <= 0] = np.nan
        return uv


@lru_cache(maxsize=16)
def _rays(camera: Pinhole) -> NDArray[np.float32]:
    u = (np.arange(camera.width_px) - camera.cx_px) / camera.fx_px
    v = (np.arange(camera.height_px) - camera.cy_px) / camera.fy_px
    rays = np.empty((camera.height_px, camera.width_px, 3), dtype=np.float32)
    rays[..., 0] = u[None, :]
    rays[..., 1] = v[:, None]
    rays[..., 2] = 1.0
    rays.setflags(write=False)
    return rays
