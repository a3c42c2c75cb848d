"""One camera: whether its stream brings pictures as its lens is described, and whether its place can be true."""

from __future__ import annotations

import math

import numpy as np

from surveilnav.cameras_file import CameraEntry, CamerasFile
from surveilnav.cameras_file.passwords import FILE_NAME
from surveilnav.cameras_file.uncalibrated import is_uncalibrated
from surveilnav.cameras_file.urls import shown
from surveilnav.cameras_file.views import views_of
from surveilnav.cli.building_check.files import Files
from surveilnav.cli.building_check.floor_check import Extent
from surveilnav.cli.calibrating import command_for
from surveilnav.cli.finding import Finding
from surveilnav.cli.stream_probe import clock_offset_s, probe

#: So far may the clock of a camera be off before people are told; its answer has whole seconds.
_CLOCK_OFF_S = 2.0
_SAME_M, _SAME_RAD = 0.05, math.radians(2.0)


def check_stream(entry: CameraEntry, cameras: CamerasFile, seconds: float) -> Finding:
    """Opens its stream and looks at what comes."""
    what = f"camera {entry.name}, stream"
    seen = probe(entry.stream, cameras.path.parent, seconds)
    if seen.size_px == (0, 0):
        missing = "environment variable" in seen.problem
        remedy = f"write it into {FILE_NAME} beside {cameras.path.name}" if missing else "correct `stream` in the file"
        return Finding(what, "problem", f"{shown(entry.stream)}: {seen.problem}", remedy)
    size_px = entry.lens.width_px, entry.lens.height_px
    if seen.size_px != size_px:
        told = "its pictures have {}x{} pixels, but its lens is given for {}x{}".format(*seen.size_px, *size_px)
        return Finding(
            what, "problem", told, "set the stream to that size, or correct width_px and height_px of its lens"
        )
    if seen.problem:
        return Finding(what, "problem", seen.problem)
    rate = f", {seen.hz:.1f} pictures a second" if seen.hz else ""
    return Finding(what, "ok", "{}x{}{}{}".format(*size_px, rate, _clock(entry, cameras)))


def _clock(entry: CameraEntry, cameras: CamerasFile) -> str:
    """Pictures count from when they arrive, so that a wrong clock does no harm; people see it in the picture."""
    off_s = clock_offset_s(entry.stream, cameras.path.parent)
    if off_s is None:
        return ""
    if abs(off_s) < _CLOCK_OFF_S:
        return ", its clock is right"
    return f", its clock is {abs(off_s):.0f} s {'ahead' if off_s > 0 else 'behind'}, which does no harm"


def check_place(entry: CameraEntry, files: Files, extent: Extent | None) -> Finding:
    """Whether it is calibrated, and may stand where it is said to.

    Args:
        extent: of its floor's plan; None: there is none.
    """
    assert files.cameras is not None
    what, floor_z_m = f"camera {entry.name}, place", files.cameras.floors[entry.floor].z_m
    again = _calibrate(entry, files)
    x, y, z = entry.position_m
    if is_uncalibrated(entry, floor_z_m):
        return Finding(what, "problem", "it isn't calibrated yet", again)
    try:
        sees_floor = _sees_floor(entry)
    except ValueError as error:
        return Finding(what, "problem", str(error), again)
    if not sees_floor:
        told = f"it sees no floor with pitch {entry.pitch_deg:g} and roll {entry.roll_deg:g} degrees"
        return Finding(what, "problem", told, again)
    if extent is not None and not extent.holds(x, y):
        told = f"({x:.2f}, {y:.2f}) m lies outside the plan of floor {entry.floor} ({extent})"
        return Finding(what, "problem", told, again)
    if twin := _twin(entry, files.cameras):
        return Finding(what, "problem", f"{twin} has the same place and direction", again)
    angles = f"yaw {entry.yaw_deg:.0f}, pitch {entry.pitch_deg:.0f} degrees"
    return Finding(what, "ok", f"({x:.2f}, {y:.2f}) m, {z - floor_z_m:.2f} m above floor {entry.floor}, {angles}")


def _calibrate(entry: CameraEntry, files: Files) -> str:
    floor = files.building.floors.get(entry.floor)
    plan = files.shown(floor.plan) if floor and floor.plan else None
    return command_for(entry.name, plan, files.shown(files.building.cameras))


def _sees_floor(entry: CameraEntry) -> bool:
    """Whether some ray of some view points below the horizon. ValueError: the lens sees too little of every view."""
    views = views_of(entry)
    k = views.intrinsics
    right, bottom = k.width_px - 1.0, k.height_px - 1.0
    corners = np.array([(0.0, 0.0), (right, 0.0), (right, bottom), (0.0, bottom)])
    rays = np.column_stack([(corners - (k.cx_px, k.cy_px)) / (k.fx_px, k.fy_px), np.ones(4)])
    return any(bool(((rays @ pose.matrix()[:3, :3].T)[:, 2] < -0.05).any()) for pose in views.poses)


def _twin(entry: CameraEntry, cameras: CamerasFile) -> str:
    """Another camera, before it in the file, with the same pose; empty: there is none."""
    for other in cameras.cameras.values():
        if other.name == entry.name:
            return ""
        T, T_other = entry.pose(), other.pose()
        turned = math.acos(max(-1.0, min(1.0, (np.trace(T[:3, :3].T @ T_other[:3, :3]) - 1) / 2)))
        if np.linalg.norm(T[:3, 3] - T_other[:3, 3]) < _SAME_M and turned < _SAME_RAD:
            return f"camera {other.name}"
    return ""
