"""What a camera sees of the floor, as an outline for a plan."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4
from surveilnav.geometry.lens import Lens

_POINTS_PER_SIDE = 24
#: Of the way from the picture's edge to its middle; a fisheye's picture doesn't fill the corners.
_INWARDS = np.linspace(0.0, 1.0, 101)[:, None, None]


def seen_floor(lens: Lens, T_world_camera: Matrix4, floor_z_m: float, reach_m: float) -> NDArray[np.float64]:
    """The outline (n, 2) as (x, y) [m] of the floor that the picture shows, clockwise in the picture from its top left.

    Its corners are at most ``reach_m`` away, also where the picture shows the horizon. Walls aren't considered.
    """
    rays = _edge_rays(lens) @ T_world_camera[:3, :3].T
    horizontal = np.linalg.norm(rays[:, :2], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance_m = np.where(rays[:, 2] < 0, (floor_z_m - T_world_camera[2, 3]) / rays[:, 2] * horizontal, np.inf)
        ahead = np.where(horizontal[:, None] > 1e-9, rays[:, :2] / horizontal[:, None], 0.0)
    return np.asarray(T_world_camera[:2, 3] + ahead * np.clip(distance_m, 0.0, reach_m)[:, None])


def _edge_rays(lens: Lens) -> NDArray[np.float64]:
    """(n, 3) in the camera's frame: of the pixels nearest to the picture's edge at which the lens sees something."""
    pinhole = lens.pinhole
    right, bottom = pinhole.width_px - 0.5, pinhole.height_px - 0.5
    corners = np.array([(-0.5, -0.5), (right, -0.5), (right, bottom), (-0.5, bottom)])
    steps = np.linspace(0.0, 1.0, _POINTS_PER_SIDE, endpoint=False)[:, None]
    edge = np.concatenate([a + steps * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    middle = np.array([pinhole.cx_px, pinhole.cy_px])
    rays = lens.rays(edge + _INWARDS * (middle - edge))
    first = np.argmax(np.isfinite(rays).all(axis=2), axis=0)
    return np.asarray(rays[first, np.arange(len(edge))])
