"""A camera's pose as people write it: yaw, pitch and roll."""

from __future__ import annotations

import math

from surveilnav.geometry import Matrix4, camera_pose

#: Nearer than this to straight down or up, only the direction of the picture's top is a yaw.
_VERTICAL_RAD = 1e-4


def yaw_pitch_roll(T_world_camera: Matrix4) -> tuple[float, float, float]:
    """Yaw, pitch and roll [rad] of ``T_world_camera`` (4, 4): the inverse of ``CameraEntry.pose``.

    Yaw turns anticlockwise from +x, pitch is positive when it looks up, and roll turns the camera clockwise about its
    axis. A camera that looks straight down has the yaw of its picture's top, and no roll.
    """
    forward, up = T_world_camera[:3, 2], -T_world_camera[:3, 1]
    across = math.hypot(forward[0], forward[1])
    pitch_rad = math.atan2(forward[2], across)
    if across < _VERTICAL_RAD:
        top = up if forward[2] < 0 else -up
        return math.atan2(top[1], top[0]), math.copysign(math.pi / 2, pitch_rad), 0.0
    yaw_rad = math.atan2(forward[1], forward[0])
    level = camera_pose((0.0, 0.0, 0.0), yaw_rad, pitch_rad)[:3, :3]
    R_level_camera = level.T @ T_world_camera[:3, :3]
    return yaw_rad, pitch_rad, math.atan2(R_level_camera[1, 0], R_level_camera[0, 0])
