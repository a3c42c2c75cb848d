"""What camera views show: the area of floor in a picture, and the part of a picture that shows an object."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole, Pose

#: Beyond this distance depth and detectors are of little use.
RANGE_M = 5.0
_POINTS_PER_SIDE = 4
#: A crop shows this share of the box's size around it, and at least so many pixels.
_MARGIN, _MIN_MARGIN_PX = 0.35, 24
#: A crop with a longer side is scaled down.
_MAX_SIDE_PX = 320
_QUALITY = 82
_FRAME_BGR = (60, 200, 255)


def floor_outline(
    T_world_camera: Pose, camera: Pinhole, floor_z_m: float, range_m: float = RANGE_M
) -> list[tuple[float, float]]:
    """The outline of the area of floor that a picture shows, by projecting the picture's edge onto the floor.

    Returns:
        (x, y) [m, world] of its corners, around the edge. They are at most ``range_m`` away, also where the picture shows the
        horizon. Walls aren't considered.
    """
    T = T_world_camera.matrix()
    p_world, rays = T[:3, 3], _edge_rays(camera) @ T[:3, :3].T
    horizontal = np.linalg.norm(rays[:, :2], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach_m = np.where(rays[:, 2] < 0, (floor_z_m - p_world[2]) / rays[:, 2] * horizontal, np.inf)
        ahead = np.where(horizontal[:, None] > 1e-9, rays[:, :2] / horizontal[:, None], 0.0)
    reach_m = np.clip(np.nan_to_num(reach_m, nan=range_m), 0.0, range_m)  # remote heights may be no numbers
    outline = p_world[:2] + ahead * reach_m[:, None]
    return [(round(float(x), 3), round(float(y), 3)) for x, y in outline]


def _edge_rays(camera: Pinhole) -> NDArray[np.float64]:
    """(N, 3): rays in the camera's frame through the picture's edge, clockwise from the top left."""
    w, h = camera.width_px - 0.5, camera.height_px - 0.5
    corners = np.array([(-0.5, -0.5), (w, -0.5), (w, h), (-0.5, h)])
    steps = np.linspace(0.0, 1.0, _POINTS_PER_SIDE, endpoint=False)[:, None]
    uv = np.concatenate([a + steps * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    return np.column_stack(
        [(uv[:, 0] - camera.cx_px) / camera.fx_px, (uv[:, 1] - camera.cy_px) / camera.fy_px, np.ones(len(uv))]
    )


def crop(jpeg: bytes, box_px: Sequence[float | None]) -> bytes:
    """A small JPEG of the part of a picture around a box (x0, y0, x1, y1) [px], with the box drawn.

    Raises:
        ValueError: it is no picture, or the box doesn't lie in it.
    """
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR) if jpeg else None
    if picture is None:
        raise ValueError("no JPEG")
    height, width = picture.shape[:2]
    if len(box_px) != 4 or any(v is None or not np.isfinite(v) for v in box_px):
        raise ValueError(f"no box: {box_px}")
    x0, y0, x1, y1 = (float(np.clip(v or 0.0, 0, end)) for v, end in zip(box_px, (width, height) * 2, strict=True))
    if not (x1 - x0 >= 1 and y1 - y0 >= 1):
        raise ValueError(f"the box {box_px} isn't in a picture of {width} x {height}")
    margin = max(_MARGIN * max(x1 - x0, y1 - y0), _MIN_MARGIN_PX)
    left, top = int(max(x0 - margin, 0)), int(max(y0 - margin, 0))
    right, bottom = int(min(x1 + margin, width)), int(min(y1 + margin, height))
    scale = min(1.0, _MAX_SIDE_PX / max(right - left, bottom - top))
    size = max(1, round((right - left) * scale)), max(1, round((bottom - top) * scale))
    small = cv2.resize(picture[top:bottom, left:right], size, interpolation=cv2.INTER_AREA)
    corners = [(round((x - left) * scale), round((y - top) * scale)) for x, y in ((x0, y0), (x1, y1))]
    cv2.rectangle(small, corners[0], corners[1], _FRAME_BGR, 2)
    return cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
