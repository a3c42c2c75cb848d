"""Active camera invocation: which cameras matter now (eq. 1)."""

from __future__ import annotations

from collections.abc import Iterable

from surveilnav.messages import CameraInfo


def active_cameras(robot_floor_z: Iterable[float], cameras: Iterable[CameraInfo], tau_z_m: float = 0.4) -> list[str]:
    """Names of the cameras on a floor that some robot stands on, sorted.

    Eq. 1: a camera is active where ``|z_hat_robot - z_hat_camera| <= tau_z``; z-hat is the sensor's altitude less
    its mounting offset, the altitude of the floor below it. ``robot_floor_z``: z-hat of each robot [m, world].
    """
    floors_z_m = list(robot_floor_z)
    return sorted(
        info.camera
        for info in cameras
        if any(abs(z_m - (info.position_m[2] - info.mounting_offset_m)) <= tau_z_m for z_m in floors_z_m)
    )
