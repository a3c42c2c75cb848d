"""Where a thing stands that was seen without depth: its mask's lowest point lies on the floor, or as high as its class stands.

The distance at which the ray through that point meets that plane is as uncertain as the ray's angle. With the camera at height
h above the plane and the thing at a horizontal distance r, an error d of the angle moves it by ``(h^2 + r^2) / h * d``, and an
error e of the plane's height by ``r / h * e``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.sensing.views import DetectedObject, PosedView, box_cells
from surveilnav.services.fusion.core.objects.config import FootPointConfig
from surveilnav.services.fusion.core.objects.sizes import base_prior

_MAX_POINTS = 400
#: A mask that reaches so near to the lower edge of the picture is cut off by it: its lowest point isn't the foot.
_EDGE_PX = 2
#: The lowest pixels of a mask: this share of its height, so that one stray pixel isn't the foot.
_FOOT_SHARE = 0.04
_MAX_THICKNESS_M = 0.8
#: How uncertain a place is across the ray, beside the camera's direction.
_ACROSS_M = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class EstimatedPlace:
    """Where a thing is that no sensor measured.

    Attributes:
        p_world: (N, 3) its points [m, world].
        covariance_m2: (2, 2) of its horizontal position.
        range_m: its horizontal distance from the camera.
    """

    p_world: NDArray[np.floating]
    covariance_m2: NDArray[np.float64]
    range_m: float

    @classmethod
    def along_ray(
        cls,
        p_world: NDArray[np.floating],
        ahead: NDArray[np.floating],
        along_m: float,
        range_m: float,
        config: FootPointConfig,
    ) -> EstimatedPlace:
        """A place whose standard deviation is ``along_m`` along the ray, whose horizontal direction is ``ahead`` (2,)."""
        across_m = math.hypot(range_m * config.sigma_pose_rad, _ACROSS_M)
        side = np.array([-ahead[1], ahead[0]])
        covariance_m2 = along_m**2 * np.outer(ahead, ahead) + across_m**2 * np.outer(side, side)
        return cls(p_world, covariance_m2, range_m)


def locate_by_foot(
    view: PosedView, detection: DetectedObject, floor_z_m: float, config: FootPointConfig
) -> EstimatedPlace | None:
    """Locates a detection in a view without a depth sensor; None if its foot can't be seen, or is too uncertain.

    Args:
        floor_z_m: altitude of the floor [m, world].
    """
    v, u = _mask_pixels(detection, view)
    if not len(v) or v.max() >= view.camera.height_px - 1 - _EDGE_PX:
        return None
    base = base_prior(detection.label)
    lowest = v >= v.max() - max(1.0, _FOOT_SHARE * (v.max() - v.min()))
    foot_uv = float(np.median(u[lowest])), float(v.max()) + 0.5
    T = view.T_world_camera
    ray = T[:3, :3] @ _ray(view, *foot_uv)
    height_m = float(T[2, 3]) - floor_z_m - base.height_m
    if height_m <= 0.1 or ray[2] > -0.02 * float(np.linalg.norm(ray)):
        return None
    foot = T[:3, 3] + ray * (height_m / -ray[2])
    away = foot[:2] - T[:2, 3]
    range_m = float(np.linalg.norm(away))
    angle_rad = math.hypot(config.sigma_px / view.camera.fy_px, config.sigma_pose_rad)
    along_m = math.hypot((height_m**2 + range_m**2) / height_m * angle_rad, range_m / height_m * base.sigma_m)
    if range_m < 1e-3 or range_m > config.max_range_m or along_m > config.max_sigma_m:
        return None
    ahead = away / range_m
    p_world = _slab(view, u, v, foot, ahead)
    if not len(p_world):
        return None
    return EstimatedPlace.along_ray(p_world, ahead, along_m, range_m, config)


def _mask_pixels(detection: DetectedObject, view: PosedView) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rows and columns of the pixels of a mask, or of the box if there is no mask."""
    x0, y0, x1, y1 = box_cells(detection.box_px, view.camera.width_px, view.camera.height_px)
    mask = np.ones((y1 - y0, x1 - x0), np.bool_) if detection.mask is None else detection.mask
    v, u = np.nonzero(mask)
    return (v + y0).astype(np.float64), (u + x0).astype(np.float64)


def _ray(view: PosedView, u: NDArray[np.float64] | float, v: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Rays (3, ...) in the camera's frame with z = 1."""
    c = view.camera
    x, y = (np.asarray(u) - c.cx_px) / c.fx_px, (np.asarray(v) - c.cy_px) / c.fy_px
    return np.stack([x, y, np.ones_like(x)])


def _slab(
    view: PosedView,
    u: NDArray[np.float64],
    v: NDArray[np.float64],
    foot: NDArray[np.float64],
    ahead: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The outline on an upright plane through the foot that faces the camera, made as thick as half of its width."""
    step = max(1, len(u) // _MAX_POINTS)
    rays = (view.T_world_camera[:3, :3] @ _ray(view, u[::step], v[::step])).T
    towards = rays[:, :2] @ ahead
    p_camera = view.T_world_camera[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = float((foot[:2] - p_camera[:2]) @ ahead) / towards
    face = p_camera + rays * scale[:, None]
    face = face[(towards > 1e-6) & (face[:, 2] >= foot[2] - 0.05) & (face[:, 2] <= foot[2] + 2.5)]
    if not len(face):
        return np.empty((0, 3))
    across = face[:, :2] @ np.array([-ahead[1], ahead[0]])
    thickness_m = min(_MAX_THICKNESS_M, 0.5 * float(across.max() - across.min()))
    back = np.array([*ahead, 0.0])
    return np.concatenate([face + back * d for d in np.arange(0.0, thickness_m + 1e-9, 0.05)])
