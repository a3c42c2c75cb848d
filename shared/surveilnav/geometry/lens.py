"""Lenses of real cameras, and the maps that turn their pictures into those of a pinhole camera.

A lens maps a direction in the camera's frame to a pixel. Two models cover what building cameras have:

``BrownConrady``    ordinary lenses; radial and tangential distortion as in OpenCV's ``projectPoints`` and ROS's ``plumb_bob``
                    and ``rational_polynomial`` (Brown 1966, Conrady 1919)
``KannalaBrandt``   fisheye lenses; an odd polynomial of the angle to the optical axis as in OpenCV's ``fisheye`` module and
                    ROS's ``equidistant`` (Kannala & Brandt 2006)

OpenCV makes undistortion maps, too, but divides by the depth of a ray. That fails for rays 90 degrees and more from the axis,
which a fisheye lens on the ceiling sees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry.camera import Pinhole

_SAMPLES = 4096  # of the radius or angle, to find up to where a distortion grows, and to invert it
_NEWTON_STEPS = 3  # from a radial solution, which is a few pixels off
_STEP = 1e-6  # of numerical derivatives, on the plane at depth 1
_STEPS = np.array([[_STEP, 0.0, 0.0], [0.0, _STEP, 0.0]])


@dataclass(frozen=True)
class BrownConrady:
    """An ordinary lens.

    Attributes:
        pinhole: size, focal lengths and principal point of the distorted picture.
        distortion: k1, k2, p1, p2[, k3[, k4, k5, k6]] in OpenCV's order; shorter ones are filled up with zeros.
    """

    pinhole: Pinhole
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if len(self.distortion) not in (0, 1, 2, 4, 5, 8) or not all(map(math.isfinite, self.distortion)):
            raise ValueError(f"a pinhole lens has 0, 4, 5 or 8 finite coefficients, got {list(self.distortion)}")

    def pixels(self, rays: NDArray[np.floating]) -> NDArray[np.float64]:
        """The pixels (..., 2) as (u, v) of directions (..., 3) in the camera's frame; NaN where the lens sees nothing."""
        _, _, p1, p2, *_ = _padded(self.distortion, 8)
        z = rays[..., 2].astype(np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = rays[..., 0] / z, rays[..., 1] / z
            r2 = x * x + y * y
            radial = self._radial(r2)
            xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
            yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        seen = (z > 0) & (r2 <= self._max_radius**2)
        return _to_pixels(xd, yd, seen, self.pinhole)

    def rays(self, pixels: NDArray[np.floating]) -> NDArray[np.float64]:
        """The directions (..., 3), of length 1, that the pixels (..., 2) show; NaN where the lens sees nothing."""
        xd, yd = _from_pixels(pixels, self.pinhole)
        r = np.linspace(0.0, self._max_radius, _SAMPLES)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = _undistorted_radius(np.hypot(xd, yd), r, r * self._radial(r * r)) / np.hypot(xd, yd)
        scale = np.where(np.hypot(xd, yd) > 0, scale, 1.0)
        rays = np.stack([xd * scale, yd * scale, np.ones_like(xd)], axis=-1)
        for _ in range(_NEWTON_STEPS if any(self.distortion[2:4]) else 0):  # the tangential part
            du, dv = (self.pixels(rays + step) - self.pixels(rays) for step in _STEPS)
            off, det = pixels - self.pixels(rays), du[..., 0] * dv[..., 1] - du[..., 1] * dv[..., 0]
            rays[..., 0] += _STEP * (off[..., 0] * dv[..., 1] - off[..., 1] * dv[..., 0]) / det
            rays[..., 1] += _STEP * (off[..., 1] * du[..., 0] - off[..., 0] * du[..., 1]) / det
        return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))

    @property
    def hfov_rad(self) -> float:
        """The horizontal field of view that the lens would have without its distortion."""
        return self.pinhole.hfov_rad

    @cached_property
    def _max_radius(self) -> float:
        """The undistorted radius up to which the distorted one grows; beyond it, a polynomial folds back into the picture."""
        r = np.linspace(0.0, 12.0, _SAMPLES)
        with np.errstate(divide="ignore", invalid="ignore"):
            return _grows_up_to(r, r * self._radial(r * r))

    def _radial(self, r2: NDArray[np.float64]) -> NDArray[np.float64]:
        """The factor by which distortion moves a point away from the axis, by its squared radius."""
        k1, k2, _, _, k3, k4, k5, k6 = _padded(self.distortion, 8)
        return (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))


@dataclass(frozen=True)
class KannalaBrandt:
    """A fisheye lens.

    Attributes:
        pinhole: size, focal lengths [px/rad on the axis] and principal point of the distorted picture.
        distortion: k1 to k4 of ``theta (1 + k1 theta^2 + k2 theta^4 + ...)``; none: equidistant.
        max_angle_rad: the largest angle to the optical axis that the lens sees.
    """

    pinhole: Pinhole
    distortion: tuple[float, ...] = ()
    max_angle_rad: float = math.radians(100.0)

    def __post_init__(self) -> None:
        if len(self.distortion) not in (0, 4) or not all(map(math.isfinite, self.distortion)):
            raise ValueError(f"a fisheye lens has 0 or 4 finite coefficients, got {list(self.distortion)}")

    def pixels(self, rays: NDArray[np.floating]) -> NDArray[np.float64]:
        """The pixels (..., 2) as (u, v) of directions (..., 3) in the camera's frame; NaN where the lens sees nothing."""
        x, y, z = (rays[..., i].astype(np.float64) for i in range(3))
        across = np.hypot(x, y)
        theta = np.arctan2(across, z)
        theta_d = self._distorted(theta)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(across > 0, theta_d / across, 0.0)
        return _to_pixels(x * scale, y * scale, theta <= self._max_theta_rad, self.pinhole)

    def rays(self, pixels: NDArray[np.floating]) -> NDArray[np.float64]:
        """The directions (..., 3), of length 1, that the pixels (..., 2) show; NaN where the lens sees nothing."""
        xd, yd = _from_pixels(pixels, self.pinhole)
        theta = np.linspace(0.0, self._max_theta_rad, _SAMPLES)
        across = np.hypot(xd, yd)
        angle = _undistorted_radius(across, theta, self._distorted(theta))
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(across > 0, np.sin(angle) / across, 1.0)
        return np.stack([xd * scale, yd * scale, np.cos(angle)], axis=-1)

    @property
    def hfov_rad(self) -> float:
        """The horizontal field of view of a picture whose principal point is in the middle; at most a full circle."""
        theta = np.linspace(0.0, math.pi, _SAMPLES)
        edge = np.array(self.pinhole.width_px / (2 * self.pinhole.fx_px))
        return 2.0 * min(
            math.pi, float(np.nan_to_num(_undistorted_radius(edge, theta, self._distorted(theta)), nan=math.pi))
        )

    def _distorted(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        k1, k2, k3, k4 = _padded(self.distortion, 4)
        t2 = theta * theta
        return theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))

    @cached_property
    def _max_theta_rad(self) -> float:
        theta = np.linspace(0.0, self.max_angle_rad, _SAMPLES)
        return _grows_up_to(theta, self._distorted(theta))


Lens = BrownConrady | KannalaBrandt


@dataclass(frozen=True, eq=False)
class Undistortion:
    """Makes a pinhole camera's pictures from those of a lens. Its map is computed once.

    Attributes:
        view: the pinhole camera whose picture is made.
        map_px: (height, width, 2) float32: for each of its pixels the (u, v) in the shrunken picture of the lens; -1 where the
            lens sees nothing.
        shrink: by which the lens's picture is shrunk first, because a pixel of the view covers several of its pixels.
    """

    view: Pinhole
    map_px: NDArray[np.float32]
    shrink: int

    @classmethod
    def from_lens(cls, lens: Lens, view: Pinhole, R_lens_view: NDArray[np.float64] | None = None) -> Undistortion:
        """The map for a pinhole camera at the lens's position.

        Args:
            R_lens_view: (3, 3) rotation from the pinhole camera's frame to the lens's; None: both look in the same direction.
        """
        rays = view.rays().astype(np.float64)
        uv = lens.pixels(rays if R_lens_view is None else rays @ R_lens_view.T)
        inside = (
            (uv[..., 0] >= -0.5)
            & (uv[..., 0] <= lens.pinhole.width_px - 0.5)
            & (uv[..., 1] >= -0.5)
            & (uv[..., 1] <= lens.pinhole.height_px - 0.5)
        )  # False for NaN
        shrink = _pixels_per_pixel(uv)
        uv = (uv + 0.5) / shrink - 0.5
        return cls(view, np.where(inside[..., None], uv, -1.0).astype(np.float32), shrink)

    @cached_property
    def seen(self) -> NDArray[np.bool_]:
        """(height, width): the pixels that the lens sees."""
        return np.asarray(self.map_px[..., 0] > -0.75)

    def picture(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The pinhole camera's picture (height, width, 3) of a lens's; black where the lens sees nothing."""
        out = self._remap(rgb)
        out[~self.seen] = 0
        return np.asarray(out)

    def mask(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The pixels of the pinhole camera's picture to which a masked pixel of the lens contributes, or none at all."""
        return np.asarray((self._remap(mask.astype(np.float32)) > 0.0) | ~self.seen)

    def _remap(self, picture: NDArray) -> NDArray:
        if self.shrink > 1:
            height, width = picture.shape[:2]
            size = math.ceil(width / self.shrink), math.ceil(height / self.shrink)
            bottom, right = size[1] * self.shrink - height, size[0] * self.shrink - width
            padded = cv2.copyMakeBorder(picture, 0, bottom, 0, right, cv2.BORDER_REPLICATE)
            picture = cv2.resize(padded, size, interpolation=cv2.INTER_AREA)
        return np.asarray(cv2.remap(picture, self.map_px, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def _padded(values: tuple[float, ...], n: int) -> tuple[float, ...]:
    return (*values, *([0.0] * (n - len(values))))


def _grows_up_to(x: NDArray[np.float64], distorted: NDArray[np.float64]) -> float:
    """The largest of ``x`` up to which ``distorted`` grows strictly."""
    falls = np.nonzero(~(np.diff(distorted) > 0))[0]
    return float(x[falls[0]] if len(falls) else x[-1])


def _undistorted_radius(
    distorted: NDArray[np.float64], samples: NDArray[np.float64], distorted_samples: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The radius or angle that a lens moves to ``distorted``, between samples of it; NaN beyond the last.

    With 4096 samples, linear interpolation is exact to about 1e-6 of the radius: a hundredth of a pixel at most.
    """
    grows = np.concatenate([[True], np.diff(distorted_samples) > 0])
    grows = np.logical_and.accumulate(grows)
    return np.asarray(np.interp(distorted, distorted_samples[grows], samples[grows], right=np.nan))


def _pixels_per_pixel(uv: NDArray[np.float64]) -> int:
    """The number of the lens's pixels from one pixel of the view to the next, rounded down; at least 1."""
    steps = np.hypot(*np.diff(uv, axis=1).transpose(2, 0, 1))
    steps = steps[np.isfinite(steps)]
    return max(1, int(np.median(steps) + 1e-6)) if steps.size else 1


def _from_pixels(pixels: NDArray[np.floating], pinhole: Pinhole) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distorted coordinates x, y of pixels (..., 2) on the plane at depth 1."""
    xd = (pixels[..., 0].astype(np.float64) - pinhole.cx_px) / pinhole.fx_px
    return xd, (pixels[..., 1].astype(np.float64) - pinhole.cy_px) / pinhole.fy_px


def _to_pixels(
    x: NDArray[np.float64], y: NDArray[np.float64], seen: NDArray[np.bool_], pinhole: Pinhole
) -> NDArray[np.float64]:
    uv = np.stack([pinhole.fx_px * x + pinhole.cx_px, pinhole.fy_px * y + pinhole.cy_px], axis=-1)
    uv[~seen] = np.nan
    return uv
