"""What stands in ``cameras.yaml`` for the place of a camera that nobody has measured yet."""

from __future__ import annotations

from surveilnav.cameras_file.model import CameraEntry

#: Height above the floor.
HEIGHT_M = 2.5


def placeholder(floor_z_m: float = 0.0) -> dict[str, str]:
    """The entries of such a camera, as YAML."""
    return {"position_m": f"[0, 0, {floor_z_m + HEIGHT_M:g}]", "yaw_deg": "0", "pitch_deg": "0"}


def is_uncalibrated(entry: CameraEntry, floor_z_m: float) -> bool:
    """Whether a camera has that place still, which no calibration gives to the millimetre."""
    x, y, z = entry.position_m
    angles = entry.yaw_deg, entry.pitch_deg, entry.roll_deg
    return not (x or y or any(angles)) and abs(z - floor_z_m - HEIGHT_M) < 1e-6
