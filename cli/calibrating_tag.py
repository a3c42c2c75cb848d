"""``surveilnav cameras calibrate-tag``: from files and a running system to poses, which are printed and written."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from surveilnav.camera_pose.tag import (
    MIN_STOPS,
    Sightings,
    Stop,
    Tag,
    TagFit,
    load_sightings,
    save_sightings,
    solve_tag,
    tag_picture,
)
from surveilnav.cameras_file import CameraEntry, CamerasFile, load_cameras
from surveilnav.cameras_file.edit import write_camera
from surveilnav.cli.calibrating import is_good, is_usable, lines_of_pose, numbers_of_pose, yaml_of_pose
from surveilnav.cli.collecting_tag import CameraWatch, RobotWatch, collect
from surveilnav.errors import ConfigError, PoseError

if TYPE_CHECKING:
    from rich.console import Console

    from surveilnav.client import Client


@dataclass(frozen=True, eq=False)
class TagCalibration:
    """The cameras of a file, and all sightings so far."""

    cameras: CamerasFile
    path: Path
    sightings: Sightings

    @classmethod
    def from_files(
        cls, cameras_file: Path, path: Path, tag_id: int, size_m: float | None, height_m: float | None
    ) -> TagCalibration:
        """Reads both files. A size or height that is given replaces the one with which the sightings were made.

        Raises:
            ConfigError: one of the files has a mistake, or it isn't known how large the tag is.
        """
        cameras = load_cameras(cameras_file)
        if not cameras.cameras:
            faults = "".join(f"\n{problem}" for problem in cameras.problems)
            raise ConfigError(f"{cameras_file}: no camera in it can be used{faults}")
        if path.exists():
            made = cls(cameras, path, load_sightings(path))
            tag = made.sightings.tag
            if tag.id != tag_id:
                raise ConfigError(
                    f"{path} has sightings of tag {tag.id}, not of {tag_id}: give --tag-id or --sightings"
                )
            made.sightings.tag = Tag(id=tag_id, size_m=size_m or tag.size_m, height_m=_or(height_m, tag.height_m))
            for stop in made.sightings.stops:
                made.require_floor(stop.floor, f"{path}, line {stop.line}: this stop")
            return made
        missing = [name for name, value in (("--tag-size", size_m), ("--tag-height", height_m)) if value is None]
        if size_m is None or height_m is None:
            raise ConfigError(
                f"there is no {path} yet, so {' and '.join(missing)} must be given: the side of the printed black square, and "
                "the height of its centre above the floor. A robot that drives on a floor can't tell heights"
            )
        return cls(cameras, path, Sightings(Tag(id=tag_id, size_m=size_m, height_m=height_m)))

    def require_floor(self, floor: str, what: str) -> None:
        """Raises ConfigError if the file of cameras doesn't have this floor."""
        if floor not in self.cameras.floors:
            known = ", ".join(self.cameras.floors) or "none"
            raise ConfigError(f"{what} is on floor {floor!r}, but the floors of {self.cameras.path} are {known}")

    def add(self, stop: Stop) -> None:
        """Adds a stop to the sightings and to their file."""
        self.sightings.stops.append(stop)
        save_sightings(self.path, self.sightings)

    def solve(self) -> TagFit:
        """The poses by all sightings. PoseError: none can be found."""
        lenses = {name: entry.lens.lens() for name, entry in self.cameras.cameras.items()}
        return solve_tag(lenses, self.sightings, {floor: entry.z_m for floor, entry in self.cameras.floors.items()})

    def is_complete(self, fit: TagFit) -> bool:
        """Whether the poses of all cameras on the floors that the robot stopped on are certain enough for searches."""
        floors = {stop.floor for stop in self.sightings.stops}
        return all(
            (camera := fit.cameras.get(name)) is not None and is_good(camera)
            for name, entry in self.cameras.cameras.items()
            if entry.floor in floors
        )


def _or(value: float | None, default: float) -> float:
    return default if value is None else value


def follow(made: TagCalibration, gateway: Client, robot: str, console: Console) -> None:
    """Collects sightings until all cameras are certain enough, or until Ctrl-C. Each stop is kept at once."""
    stopping = threading.Event()

    def tell(line: str) -> None:
        console.print(line, markup=False, soft_wrap=True)

    def open_camera(entry: CameraEntry) -> CameraWatch:
        return CameraWatch(entry, made.cameras.path.parent, made.sightings.tag.id, tell)

    tell("Drive the robot, and stop for some seconds in view of the cameras, in different directions. Ctrl-C ends it.")
    for problem in made.cameras.problems:
        tell(f"{made.cameras.path}, {problem}")
    # No exception: one that comes while a stream is being closed would leave it open.
    before = signal.signal(signal.SIGINT, lambda *_: stopping.set())
    try:
        collect(RobotWatch(gateway, robot), made.cameras.cameras, open_camera, _wanted(made, tell), stopping, tell)
    finally:
        signal.signal(signal.SIGINT, before)


def _wanted(made: TagCalibration, tell: Callable[[str], None]) -> Callable[[Stop], bool]:
    """Keeps a stop, tells what it brought, and says whether more are wanted."""

    def wanted(stop: Stop) -> bool:
        made.require_floor(stop.floor, f"robot {stop.robot}")
        where = f"{stop.x_m:.2f}, {stop.y_m:.2f} m, {math.degrees(stop.yaw_rad):.0f} degrees"
        if not stop.seen:
            tell(f"stop at {where}: no camera sees the tag")
            return True
        made.add(stop)
        tell(f"stop {len(made.sightings.stops)} at {where}: seen by {', '.join(stop.seen)}")
        try:
            fit = made.solve()
        except PoseError:
            fit = TagFit({})
        for name in stop.seen:
            tell(f"  {name}: {_so_far(made, fit, name)}")
        return not made.is_complete(fit)

    return wanted


def _so_far(made: TagCalibration, fit: TagFit, name: str) -> str:
    n = made.sightings.count(name)
    camera = fit.cameras.get(name)
    if camera is not None:
        angle = math.degrees(camera.angle_sigma_rad)
        return f"{n} stops, ± {camera.position_sigma_m:.2f} m, ± {angle:.1f} degrees"
    return f"{n} of {MIN_STOPS} stops" if n < MIN_STOPS else f"{n} stops, but {fit.refused.get(name, 'no pose yet')}"


def write(made: TagCalibration, fit: TagFit) -> None:
    """Writes the poses into the file of cameras. ConfigError: one can't be written."""
    for name, camera in fit.cameras.items():
        write_camera(made.cameras.path, name, yaml_of_pose(camera.T_world_camera))


def write_tag(out: Path, tag_id: int) -> None:
    """Writes the picture of a tag. ConfigError: it can't be written."""
    try:
        written = cv2.imwrite(str(out), tag_picture(tag_id))
    except cv2.error:
        raise ConfigError(f"{out}: expected a name that ends with .png") from None
    if not written:
        raise ConfigError(f"{out}: it can't be written; does its folder exist?")


def as_json(made: TagCalibration, fit: TagFit, written: bool) -> dict[str, Any]:
    """For programs."""
    cameras = {}
    for name, camera in fit.cameras.items():
        cameras[name] = {
            **numbers_of_pose(camera),
            "stops": list(camera.stops),
            "residual_px": round(camera.residual_px, 2),
        }
    return {
        "cameras": cameras,
        "refused": fit.refused,
        "left_out": [
            {
                "camera": sighting.camera,
                "stop": sighting.stop,
                "off_m": round(sighting.off_m, 3) if math.isfinite(sighting.off_m) else None,
            }
            for sighting in fit.left_out
        ],
        "tag_on_robot_m": [round(float(x), 4) for x in fit.T_robot_tag[:3, 3]],
        "written": written,
    }


def show(made: TagCalibration, fit: TagFit, console: Console) -> None:
    """For people: what was left out, where the tag sits, and each camera's pose with its uncertainty."""

    def tell(line: str, style: str = "") -> None:
        console.print(line, markup=False, style=style, soft_wrap=True)

    for sighting in fit.left_out:
        stop = made.sightings.stops[sighting.stop - 1]
        where = f"stop {sighting.stop} ({stop.x_m:.2f}, {stop.y_m:.2f} m)"
        off = f"{100 * sighting.off_m:.0f} cm and {math.degrees(sighting.off_rad):.0f} degrees"
        off = (
            f"by {sighting.camera}, the robot was {off} from there" if math.isfinite(sighting.off_m) else "out of sight"
        )
        tell(f"{where}: {off}   left out: it contradicts the others", "red")
    for name, why in fit.refused.items():
        tell(f"{name}: {why}", "yellow")
    tell(_tag_in_words(fit))
    for name, camera in fit.cameras.items():
        floor_z_m = made.cameras.floors[made.cameras.cameras[name].floor].z_m
        tell(f"\n{name}: {len(camera.stops)} stops, {camera.residual_px:.1f} px off")
        for line in lines_of_pose(camera, floor_z_m):
            tell(line)
        if not is_usable(camera):
            tell(
                "That is too uncertain for searches, which need 0.05 m and 1 degree: make more stops in its view.",
                "yellow",
            )
        tell(f"# {name} in cameras.yaml")
        for entry, value in yaml_of_pose(camera.T_world_camera).items():
            tell(f"{entry}: {value}")


def _tag_in_words(fit: TagFit) -> str:
    """Where on the robot the tag sits, so that people can check it with a look at the robot."""
    x, y, _ = fit.T_robot_tag[:3, 3]
    normal = fit.T_robot_tag[:3, 2]
    ahead = f"{abs(x):.2f} m {'ahead of' if x >= 0 else 'behind'} the robot's centre"
    side = f"{abs(y):.2f} m to its {'left' if y >= 0 else 'right'}"
    up = math.degrees(math.asin(float(np.clip(normal[2], -1, 1))))
    aside = round(math.degrees(math.atan2(normal[1], normal[0])))
    faces = f"{aside} degrees from ahead, " if abs(up) < 80 else ""
    return f"the tag sits {ahead} and {side}; it faces {faces}{up:.0f} degrees upwards"
