"""A robot with an AprilTag that made-up cameras see: for tests and for tests/bench/bench_camera_tag.py."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_pose.tag.detection import tag_corners, tag_picture
from surveilnav.geometry import Matrix4, Pinhole, base_pose, camera_pose, inverse, transform_points
from surveilnav.geometry.lens import BrownConrady, Lens

_SUPERSAMPLING = 4


def tag_on_robot(
    x_m: float = 0.12, y_m: float = 0.03, height_m: float = 0.5, yaw_rad: float = 0.0, tilt_rad: float = 0.5
) -> Matrix4:
    """``T_robot_tag``: the tag faces along the robot's yaw, tilted upwards by ``tilt_rad``; its pattern stands upright."""
    looking = camera_pose((x_m, y_m, height_m), yaw_rad, tilt_rad)  # z along the tag's normal, y down
    looking[:3, :3] = looking[:3, :3] @ np.diag([-1.0, -1.0, 1.0])  # seen from the front, x is to the right and y up
    return looking


def render_tag(
    lens: Lens, T_camera_tag: Matrix4, size_m: float, id: int = 0, background: int = 110
) -> NDArray[np.uint8]:
    """(height, width, 3): a grey picture with the tag in it, on a white sheet a module wider on each side."""
    sheet = tag_picture(id, module_px=1)
    n = len(sheet)
    width, height = lens.pinhole.width_px, lens.pinhole.height_px
    picture = np.full((height, width), float(background))
    outer = lens.pixels(transform_points(T_camera_tag, tag_corners(size_m * n / (n - 2))))
    left, top = np.maximum(0, np.floor(np.nanmin(outer, axis=0) - 2)).astype(int)
    right, bottom = (
        np.minimum([width, height], np.ceil(np.nanmax(outer, axis=0)) + 3).astype(int) if np.isfinite(outer).all() else (left, top)
    )
    if right <= left or bottom <= top:
        return np.repeat(picture[..., None], 3, axis=-1).astype(np.uint8)
    k = _SUPERSAMPLING
    u = left + (np.arange((right - left) * k) + 0.5) / k - 0.5
    v = top + (np.arange((bottom - top) * k) + 0.5) / k - 0.5
    rays = lens.rays(np.stack(np.meshgrid(u, v), axis=-1)) @ T_camera_tag[:3, :3]
    origin = inverse(T_camera_tag)[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = -origin[2] / rays[..., 2]
        column = (origin[0] + along * rays[..., 0]) / size_m * (n - 2) + n / 2
        row = n / 2 - (origin[1] + along * rays[..., 1]) / size_m * (n - 2)
    on = (along > 0) & (column >= 0) & (column < n) & (row >= 0) & (row < n)
    value = np.full(on.shape, float(background))
    value[on] = 20.0 + 0.8 * sheet[row[on].astype(int), column[on].astype(int)]
    shape = bottom - top, k, right - left, k
    picture[top:bottom, left:right] = value.reshape(shape).mean(axis=(1, 3))
    return np.repeat(picture[..., None], 3, axis=-1).astype(np.uint8)
