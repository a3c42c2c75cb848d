"""A room with a door, a niche and a pillar, its floor plan, and what a camera in its corner sees: to test calibration with."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import camera_pose
from tests.clicked_points import LENS

FLOOR_Z_M = 3.5
RESOLUTION_M = 0.02
ORIGIN_M = (-1.0, -1.0)
#: The camera hangs 2.5 m above the floor.
T_WORLD_CAMERA = camera_pose((0.2, 0.3, FLOOR_Z_M + 2.5), math.radians(38), math.radians(-22))
#: Corners (x, y) [m] of the room; between the third and the fourth is a door of 0.9 x 2 m.
ROOM = (
    (0.0, 0.0),
    (7.0, 0.0),
    (7.0, 1.8),
    (7.0, 2.7),
    (7.0, 5.0),
    (4.0, 5.0),
    (4.0, 4.2),
    (2.6, 4.2),
    (2.6, 5.0),
    (0.0, 5.0),
)
PILLAR = ((4.4, 2.0), (4.8, 2.0), (4.8, 2.4), (4.4, 2.4))
_DOOR, _DOOR_TOP_M, _CEILING_M = 2, 2.0, 2.8
#: Places (x, y, z above the floor) [m] that the camera sees and that are on the plan.
LANDMARKS = (
    (7.0, 1.8, 0.0),
    (7.0, 2.7, 0.0),
    (7.0, 1.8, 2.0),
    (7.0, 2.7, 2.0),
    (7.0, 5.0, 0.0),
    (4.4, 2.0, 0.0),
    (4.4, 2.4, 0.0),
    (4.8, 2.0, 0.0),
    (4.0, 4.2, 0.0),
    (2.6, 4.2, 0.0),
)


def pixels_of(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the camera's picture shows places (n, 3) above the floor."""
    p_world = places + np.array([0.0, 0.0, FLOOR_Z_M])
    return LENS.pixels((p_world - T_WORLD_CAMERA[:3, 3]) @ T_WORLD_CAMERA[:3, :3])


@cache
def picture() -> NDArray[np.uint8]:
    """(960, 1280, 3): tiles of half a metre on the floor, walls in a shade each, the door's opening dark."""
    size = LENS.pinhole.width_px, LENS.pinhole.height_px
    u, v = np.meshgrid(np.arange(size[0], dtype=float), np.arange(size[1], dtype=float))
    rays = LENS.rays(np.stack([u, v], axis=-1)) @ T_WORLD_CAMERA[:3, :3].T
    eye = T_WORLD_CAMERA[:3, 3] - [0.0, 0.0, FLOOR_Z_M]
    with np.errstate(divide="ignore", invalid="ignore"):
        nearest = np.where(rays[..., 2] < 0, -eye[2] / rays[..., 2], np.inf)
        floor = eye + np.where(np.isfinite(nearest), nearest, 0.0)[..., None] * rays
        tiles = (np.floor(2 * floor[..., 0]) + np.floor(2 * floor[..., 1])) % 2
        shade = np.where(rays[..., 2] < 0, 118.0 + 14.0 * tiles, 225.0)
        for number, (a, b) in enumerate(_sides()):
            along = np.subtract(b, a)
            det = rays[..., 0] * along[1] - rays[..., 1] * along[0]
            t = ((a[0] - eye[0]) * along[1] - (a[1] - eye[1]) * along[0]) / det
            s = ((a[0] - eye[0]) * rays[..., 1] - (a[1] - eye[1]) * rays[..., 0]) / det
            z = eye[2] + t * rays[..., 2]
            hit = (t > 0) & (t < nearest) & (s >= 0) & (s <= 1) & (z >= 0) & (z <= _CEILING_M)
            wall = 165.0 + 12.0 * (number * 7 % 5)
            shade = np.where(hit, np.where((number == _DOOR) & (z < _DOOR_TOP_M), 60.0, wall), shade)
            nearest = np.where(hit, t, nearest)
    return np.repeat(shade[..., None], 3, axis=2).astype(np.uint8)


def write_room(folder: Path) -> None:
    """Writes ``map.yaml`` with its picture, ``frame.png``, ``frames/1.png`` and ``cameras.yaml`` with the pose guessed."""
    plan = np.full((350, 450), 255, np.uint8)
    for (x0, y0), (x1, y1) in _sides():
        ends = [
            (round((x - ORIGIN_M[0]) / RESOLUTION_M - 0.5), round(349.5 - (y - ORIGIN_M[1]) / RESOLUTION_M))
            for x, y in ((x0, y0), (x1, y1))
        ]
        cv2.line(plan, ends[0], ends[1], 0, 2)
    cv2.imwrite(str(folder / "map.png"), plan)
    (folder / "map.yaml").write_text(
        f"image: map.png\nresolution: {RESOLUTION_M}\norigin: [{ORIGIN_M[0]}, {ORIGIN_M[1]}, 0]\n"
    )
    (folder / "frames").mkdir()
    for name in ("frame.png", "frames/1.png"):
        cv2.imwrite(str(folder / name), picture())
    (folder / "cameras.yaml").write_text(f"""\
# the first floor
floors: {{first: {{z_m: {FLOOR_Z_M}}}}}
cameras:
  - name: lobby  # by the door
    label: Lobby, by the stairs
    floor: first
    stream: frames
    position_m: [0, 0, 6]   # guessed
    yaw_deg: 0              # guessed
    lens: {{width_px: 1280, height_px: 960, hfov_deg: {math.degrees(LENS.pinhole.hfov_rad):.4f}}}
""")


def _sides() -> list[tuple[tuple[float, float], tuple[float, float]]]:
    return [pair for corners in (ROOM, PILLAR) for pair in zip(corners, corners[1:] + corners[:1], strict=True)]
