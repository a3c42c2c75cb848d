"""What of its floor a camera's view looks at: the outline of its picture, thrown on the floor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole, Pose

#: Farther off, depth and detectors are worth little.
RANGE_M = 5.0
_POINTS_A_SIDE = 4


def floor_outline(
    T_world_camera: Pose, camera: Pinhole, floor_z_m: float, range_m: float = RANGE_M
) -> list[tuple[float, float]]:
    """(x, y) [m, world] of the corners of the stretch of floor that the picture shows, going round its edge; at most
    ``range_m`` off, where it sees over the floor's end or the horizon. Walls aren't known here."""
    T = T_world_camera.matrix()
    p_world, rays = T[:3, 3], _edge(camera) @ T[:3, :3].T
    level = np.linalg.norm(rays[:, :2], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach_m = np.where(rays[:, 2] < 0, (floor_z_m - p_world[2]) / rays[:, 2] * level, np.inf)
        ahead = np.where(level[:, None] > 1e-9, rays[:, :2] / level[:, None], 0.0)
    reach_m = np.clip(np.nan_to_num(reach_m, nan=range_m), 0.0, range_m)  # a stranger's heights may be no numbers
    outline = p_world[:2] + ahead * reach_m[:, None]
    return [(round(float(x), 3), round(float(y), 3)) for x, y in outline]


def _edge(camera: Pinhole) -> NDArray[np.float64]:
    """(N, 3): rays in the camera's frame through the picture's edge, clockwise from the top left."""
    w, h = camera.width_px - 0.5, camera.height_px - 0.5
    corners = np.array([(-0.5, -0.5), (w, -0.5), (w, h), (-0.5, h)])
    steps = np.linspace(0.0, 1.0, _POINTS_A_SIDE, endpoint=False)[:, None]
    uv = np.concatenate([a + steps * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    return np.column_stack(
        [(uv[:, 0] - camera.cx_px) / camera.fx_px, (uv[:, 1] - camera.cy_px) / camera.fy_px, np.ones(len(uv))]
    )
