"""``surveilnav cameras calibrate``: a camera's pose from clicks, printed, drawn and written into the file of cameras."""

from __future__ import annotations

import math
import os
import time
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_pose import Clicks, FloorPlan, PoseFit, solve_pose
from surveilnav.camera_pose.angles import yaw_pitch_roll
from surveilnav.camera_pose.estimated_pose import EstimatedPose
from surveilnav.camera_pose.overlay import draw_overlay
from surveilnav.cameras_file import CameraEntry, load_cameras
from surveilnav.cameras_file.uncalibrated import placeholder
from surveilnav.errors import ConfigError
from surveilnav.geometry import Matrix4
from surveilnav.geometry.polygon import pixels_in

if TYPE_CHECKING:
    from rich.console import Console

_PICTURE_WAIT_S = 15.0
#: What searches need (docs/use/calibration.md).
GOOD_M, GOOD_RAD = 0.05, math.radians(1.0)
TOO_UNCERTAIN = (
    "That is too uncertain for searches, which need 0.05 m and 1 degree: add points, far apart and at several heights."
)


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A camera with its clicks and the pose that follows from them."""

    entry: CameraEntry
    floor_z_m: float
    clicks: Clicks
    p_world: NDArray[np.float64]
    fit: PoseFit
    fitted_hfov: bool

    def yaml_values(self) -> dict[str, str]:
        """What the file of cameras should say, by entry."""
        values = yaml_of_pose(self.fit.T_world_camera)
        if self.fitted_hfov:
            values["lens.hfov_deg"] = f"{math.degrees(self.fit.hfov_rad):.2f}"
        return values


def is_good(pose: EstimatedPose, factor: float = 1.0) -> bool:
    """Whether a pose is at most ``factor`` times as uncertain as searches can do with."""
    return pose.position_sigma_m <= factor * GOOD_M and pose.angle_sigma_rad <= factor * GOOD_RAD


def is_usable(pose: EstimatedPose) -> bool:
    """Whether people needn't be warned of a pose: twice as uncertain as searches can do with is too much."""
    return is_good(pose, 2.0)


def yaml_of_pose(T_world_camera: Matrix4) -> dict[str, str]:
    """What the file of cameras should say of a pose, by entry."""
    angles = [math.degrees(a) for a in yaw_pitch_roll(T_world_camera)]
    values = {"position_m": "[" + ", ".join(f"{x:.3f}" for x in T_world_camera[:3, 3]) + "]"}
    # + 0.0 makes 0 of -0
    return values | {
        name: f"{round(a, 2) + 0.0:.2f}" for name, a in zip(("yaw_deg", "pitch_deg", "roll_deg"), angles, strict=True)
    }


def command_for(camera: str, plan: Path | None, cameras_file: Path, fit_hfov: bool = False) -> str:
    """What a person types to calibrate a camera. ``plan``: its floor's; None: there is none, and points are given in metres."""
    points = f"--plan {quote(str(plan))}" if plan else f"--clicks {camera}.clicks.yaml --write"
    fit = " --fit-hfov" if fit_hfov else ""
    return f"surveilnav cameras calibrate {camera} {points}{fit} --file {quote(str(cameras_file))}"


def calibrate(camera: str, clicks: Clicks, source: Path, cameras_file: Path, fit_hfov: bool) -> Calibrated:
    """Solves for the pose of a camera of a file.

    Args:
        source: the file of the clicks or of their plan, for messages.

    Raises:
        ConfigError: the file has a mistake, or clicks and camera don't fit together.
        PoseError: the clicks don't give a pose.
    """
    entry, floor_z_m = camera_entry(camera, cameras_file)
    if clicks.camera != camera:
        raise ConfigError(f"{source}: these are clicks of camera {clicks.camera!r}, not of {camera!r}")
    require_match(entry, clicks.plan, source, fit_hfov)
    p_world = clicks.p_floor + np.array([0.0, 0.0, floor_z_m])
    fit = solve_pose(entry.lens.lens(), clicks.pixels, p_world, fit_hfov=fit_hfov, floor_z_m=floor_z_m)
    return Calibrated(entry, floor_z_m, clicks, p_world, fit, fit_hfov)


def require_match(entry: CameraEntry, plan: FloorPlan | None, source: Path, fit_hfov: bool) -> None:
    """Checks that a plan is of the camera's floor, and that the field of view of its lens can be fitted if it shall be.

    Raises:
        ConfigError: one of the two isn't so.
    """
    if plan is not None and plan.floor not in ("", entry.floor):
        raise ConfigError(
            f"{source}: the plan shows floor {plan.floor!r}, but camera {entry.name} is on floor {entry.floor!r}"
        )
    if fit_hfov and entry.lens.hfov_deg is None:
        raise ConfigError(
            f"--fit-hfov is for a lens that is given by hfov_deg; that of {entry.name} has focal_px, from a calibration"
        )


def camera_entry(camera: str, path: Path) -> tuple[CameraEntry, float]:
    """A camera of a file, and the altitude of its floor.

    Raises:
        ConfigError: the file can't be read, or it has no such camera, or a mistake in it.
    """
    file = load_cameras(path)
    if entry := file.cameras.get(camera):
        return entry, file.floors[entry.floor].z_m
    if problems := [str(p) for p in file.problems if p.camera == camera]:
        hint = ""
        if any("position_m: Field" in p or "yaw_deg: Field" in p for p in problems):
            hint = (
                f"\nUntil it is calibrated, write `position_m: {placeholder()['position_m']}` (z above the floor's z_m) and "
                "`yaw_deg: 0`."
            )
        raise ConfigError("\n".join(f"{path}, {p}" for p in problems) + hint)
    raise ConfigError(f"{path}: there is no camera {camera!r}; there are {', '.join(file.cameras) or 'none'}")


def write_overlay(made: Calibrated, out: Path, picture: Path | None, cameras_file: Path) -> None:
    """Draws plan, grid and clicks into a picture of the camera.

    Args:
        picture: as for ``camera_picture``.

    Raises:
        ConfigError: there is no picture, or it can't be written.
    """
    drawn = draw_overlay(
        camera_picture(made.entry, picture, cameras_file),
        made.fit.lens,
        made.fit.T_world_camera,
        made.floor_z_m,
        made.clicks.plan,
        made.clicks.pixels,
        made.p_world,
        made.fit.inliers,
    )
    try:
        written = cv2.imwrite(str(out), drawn)
    except cv2.error:
        raise ConfigError(f"--overlay {out}: expected a name that ends with .jpg or .png") from None
    if not written:
        raise ConfigError(f"--overlay {out}: it can't be written; does its folder exist?")


def camera_picture(entry: CameraEntry, picture: Path | None, cameras_file: Path) -> NDArray[np.uint8]:
    """A picture (height, width, 3), BGR, of a camera. Its zones are black, as everywhere.

    Args:
        picture: a picture's file; None: one is taken from the camera's stream.

    Raises:
        ConfigError: there is no picture, or it hasn't the size that the camera's lens is given for.
    """
    size = entry.lens.width_px, entry.lens.height_px
    bgr = _picture_of_stream(entry, cameras_file) if picture is None else _picture_of_file(picture)
    if bgr.shape[1::-1] != size:
        raise ConfigError(
            f"the picture has {bgr.shape[1]} x {bgr.shape[0]} pixels, but the camera's lens is given for {size[0]} x {size[1]}"
        )
    if entry.zones:
        bgr = np.where(pixels_in(entry.zones, *size)[..., None], 0, bgr).astype(np.uint8)
    return bgr


def _picture_of_file(path: Path) -> NDArray[np.uint8]:
    if not path.is_file():
        raise ConfigError(f"--picture {path}: there is no such file")
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if picture is None:
        raise ConfigError(f"--picture {path}: it isn't a picture that can be read; expected JPEG or PNG")
    return np.asarray(picture)


def _picture_of_stream(entry: CameraEntry, cameras_file: Path) -> NDArray[np.uint8]:
    from surveilnav.services.camera_node.sources.readers.choose import choose_reader
    from surveilnav.services.camera_node.sources.readers.reader import StreamError

    size = entry.lens.width_px, entry.lens.height_px
    reader = choose_reader(entry.stream, cameras_file.parent, os.environ, size, 0.0)
    try:
        reader.open()
        until_s = time.monotonic() + _PICTURE_WAIT_S
        while time.monotonic() < until_s:
            if frame := reader.read():
                return np.asarray(frame.rgb[..., ::-1])
        raise StreamError(f"no picture has come within {_PICTURE_WAIT_S:.0f} s")
    except StreamError as error:
        raise ConfigError(
            f"the stream of {entry.name} gives no picture: {error}. Save one in the browser and name it by --picture"
        ) from None
    finally:
        reader.close()


def numbers_of_pose(pose: EstimatedPose) -> dict[str, Any]:
    """A pose and its uncertainty for programs."""
    yaw, pitch, roll = (math.degrees(a) for a in yaw_pitch_roll(pose.T_world_camera))
    return {
        "position_m": [round(float(x), 4) for x in pose.T_world_camera[:3, 3]],
        "yaw_deg": round(yaw, 3),
        "pitch_deg": round(pitch, 3),
        "roll_deg": round(roll, 3),
        "position_sigma_m": round(pose.position_sigma_m, 4),
        "angle_sigma_deg": round(math.degrees(pose.angle_sigma_rad), 3),
    }


def lines_of_pose(pose: EstimatedPose, floor_z_m: float) -> list[str]:
    """A pose and its uncertainty for people."""
    yaw, pitch, roll = (math.degrees(a) for a in yaw_pitch_roll(pose.T_world_camera))
    x, y, z = pose.T_world_camera[:3, 3]
    angle = math.degrees(pose.angle_sigma_rad)
    return [
        f"position {x:.2f}, {y:.2f} m, {z - floor_z_m:.2f} m above the floor; ± {pose.position_sigma_m:.2f} m",
        f"yaw {yaw:.1f}, pitch {pitch:.1f}, roll {roll:.1f} degrees; ± {angle:.1f} degrees",
    ]


def as_json(made: Calibrated, written: bool) -> dict[str, Any]:
    """For programs."""
    fit = made.fit
    return {
        "camera": made.entry.name,
        **numbers_of_pose(fit),
        "hfov_deg": round(math.degrees(fit.hfov_rad), 3),
        "points": [
            {"line": line, "residual_px": rounded(px, 2), "residual_m": rounded(m, 4), "used": bool(used)}
            for line, px, m, used in zip(
                made.clicks.lines, np.linalg.norm(fit.residuals_px, axis=1), fit.residuals_m, fit.inliers, strict=True
            )
        ],
        "written": written,
    }


def rounded(value: float, digits: int) -> float | None:
    """A number for JSON; None if it isn't finite."""
    return round(float(value), digits) if math.isfinite(value) else None


def show(made: Calibrated, console: Console) -> None:
    """For people: how far each point is off, the pose with its uncertainty, and the lines for the file."""
    fit = made.fit
    for number, (line, px, m, used) in enumerate(
        zip(made.clicks.lines, np.linalg.norm(fit.residuals_px, axis=1), fit.residuals_m, fit.inliers, strict=True),
        start=1,
    ):
        off = f"{px:5.1f} px, {100 * m:5.1f} cm off" if math.isfinite(px) else "  out of sight"
        told = f"point {number:2} (line {line}): {off}" + ("" if used else "   left out: it contradicts the others")
        console.print(told, markup=False, style="" if used else "red", soft_wrap=True)
    lines = lines_of_pose(fit, made.floor_z_m)
    if made.fitted_hfov:
        sigma = math.degrees(fit.hfov_sigma_rad)
        lines.append(f"horizontal field of view {math.degrees(fit.hfov_rad):.1f} degrees; ± {sigma:.1f} degrees")
    for text in lines:
        console.print(text, markup=False, soft_wrap=True)
    if not is_usable(fit):
        console.print(TOO_UNCERTAIN, style="yellow", soft_wrap=True)
    console.print(f"\n# {made.entry.name} in cameras.yaml", markup=False)
    for name, value in made.yaml_values().items():
        above, _, entry = name.rpartition(".")
        console.print(f"{entry}: {value}{f'  # in {above}' if above else ''}", markup=False, soft_wrap=True)
