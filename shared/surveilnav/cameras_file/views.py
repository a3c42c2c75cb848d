"""The pinhole views that are made of one camera's picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

from surveilnav.camera_plan import views_around
from surveilnav.cameras_file.model import CameraEntry
from surveilnav.geometry import Pinhole, Pose
from surveilnav.geometry.lens import BrownConrady, Lens, Undistortion

_MAX_HFOV_RAD = math.radians(100.0)
#: A view of which the lens sees less than this share is left out.
_MIN_SEEN = 0.5


@dataclass(frozen=True, slots=True)
class CameraViews:
    """The views of one camera.

    Attributes:
        intrinsics: of each view.
        poses: ``T_world_camera`` of each view.
        undistortions: makes each view's picture from the stream's.
    """

    intrinsics: Pinhole
    poses: tuple[Pose, ...]
    undistortions: tuple[Undistortion, ...]


def views_of(entry: CameraEntry) -> CameraViews:
    """The views of a camera.

    Raises:
        ValueError: its lens sees too little of every view.
    """
    lens, T_world_lens = entry.lens.lens(), entry.pose()
    intrinsics = _intrinsics(entry, lens)
    poses, undistortions = [], []
    for T_world_view in views_around(entry.position_m) if entry.views == "around" else [T_world_lens]:
        R_lens_view = T_world_lens[:3, :3].T @ T_world_view[:3, :3]
        undistortion = Undistortion.from_lens(lens, intrinsics, R_lens_view)
        if undistortion.seen.mean() >= _MIN_SEEN:
            poses.append(Pose.from_matrix(T_world_view))
            undistortions.append(undistortion)
    if not poses:
        raise ValueError("the lens sees too little of its views: check lens, direction and view_hfov_deg")
    return CameraViews(intrinsics, tuple(poses), tuple(undistortions))


def _intrinsics(entry: CameraEntry, lens: Lens) -> Pinhole:
    """Square pixels; the height shows as much as the stream's, or as the width if the views go around."""
    picture = lens.pinhole
    hfov_rad = min(_MAX_HFOV_RAD, picture.hfov_rad if isinstance(lens, BrownConrady) else _MAX_HFOV_RAD)
    if entry.view_hfov_deg is not None:
        hfov_rad = math.radians(entry.view_hfov_deg)
    width_px = min(entry.max_width_px, picture.width_px)
    aspect = 1.0 if entry.views == "around" else picture.height_px / picture.width_px
    return Pinhole.from_hfov(width_px, max(1, round(width_px * aspect)), hfov_rad)
