"""``robot.yaml``: a real robot on the other end of ROS 2. What it may say, and how it is read."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from surveilnav import robot_body
from surveilnav.contract import ID_PATTERN
from surveilnav.errors import ConfigError
from surveilnav.file_entry import Entry, Finite
from surveilnav.robot_frame import PlanarTransform
from surveilnav.storage import atomic_write
from surveilnav.yaml_file import read_table

_Name = Annotated[str, Field(max_length=200, pattern=r"^[A-Za-z0-9_~/{}.-]*$")]


class FrameEntry(Entry):
    """Where the robot's map lies in the building."""

    x_m: Annotated[Finite, Field(ge=-1e5, le=1e5)] = Field(
        description="the origin of the robot's map in the building's frame"
    )
    y_m: Annotated[Finite, Field(ge=-1e5, le=1e5)] = Field(description="... and its y")
    yaw_deg: Finite = Field(description="direction of the map's x axis in the building's frame, anticlockwise")

    def transform(self) -> PlanarTransform:
        return PlanarTransform(self.x_m, self.y_m, math.radians(self.yaw_deg))


class FramesEntry(Entry):
    """The frames of the robot's transform tree."""

    map: _Name = Field("map", description="the frame that its localisation keeps fixed; `odom` for a robot without one")
    odom: _Name = Field("odom", description="the frame in which its odometry counts")
    base: _Name = Field("base_link", description="its base on the floor, x forward")


class TopicsEntry(Entry):
    """Topics and actions; a name without a leading slash lies in the robot's namespace. Empty: the robot doesn't have it."""

    tf: _Name = Field("/tf", description="tf2_msgs/TFMessage; `tf` if each robot has its own in its namespace")
    tf_static: _Name = Field("/tf_static", description="the same of frames that don't move")
    odometry: _Name = Field("odom", description="nav_msgs/Odometry")
    image: _Name = Field(
        "camera/color/image_raw",
        description="colour, sensor_msgs/Image, or CompressedImage if the name ends in /compressed",
    )
    depth: _Name = Field(
        "camera/depth/image_raw",
        description="depth registered to the colour picture, sensor_msgs/Image (16UC1 in mm, 32FC1 in m), or CompressedImage if "
        "the name ends in /compressedDepth",
    )
    camera_info: _Name = Field("camera/color/camera_info", description="sensor_msgs/CameraInfo of the colour picture")
    scan: _Name = Field("", description="sensor_msgs/LaserScan of a level scanner: one more source of obstacles")
    battery: _Name = Field("", description="sensor_msgs/BatteryState")
    localisation: _Name = Field(
        "",
        description="geometry_msgs/PoseWithCovarianceStamped, such as amcl_pose: says how sure the robot is of its place",
    )
    navigate_to_pose: _Name = Field("navigate_to_pose", description="Nav2's action, with `drive: waypoints`")
    velocity: _Name = Field(
        "cmd_vel", description="geometry_msgs/Twist, with `drive: actions`, and for the emergency stop"
    )
    velocity_stamped: bool = Field(False, description="the velocity is a TwistStamped")


class BodyEntry(Entry):
    """Its size."""

    radius_m: Annotated[Finite, Field(gt=0, le=2)] = Field(
        robot_body.RADIUS_M, description="radius of a disc around its base that holds it"
    )
    height_m: Annotated[Finite, Field(gt=0, le=4)] = Field(
        robot_body.HEIGHT_M, description="the room that it needs above the floor"
    )


class RobotFile(Entry):
    """One robot."""

    router: str = Field(
        min_length=1,
        max_length=300,
        description="the Zenoh router of its ROS 2 nodes (rmw_zenohd), such as tcp/10.0.0.7:7447",
    )
    domain: int = Field(0, ge=0, le=232, description="ROS_DOMAIN_ID")
    namespace: _Name = Field("", description="the namespace of its nodes, such as /robot1")
    drive: Literal["waypoints", "actions"] = Field(
        "waypoints", description="waypoints: it drives by Nav2; actions: it is driven by velocities, step by step"
    )
    floor: str = Field(pattern=ID_PATTERN, description="the floor that it is on")
    floor_z_m: Finite = Field(0.0, description="altitude of that floor in the building's frame")
    T_building_map: FrameEntry | None = Field(
        None, description="where its map lies in the building; without it nothing that it sees is used"
    )
    frames: FramesEntry = FramesEntry()
    topics: TopicsEntry = TopicsEntry()
    body: BodyEntry = BodyEntry()
    depth_range_m: tuple[Annotated[Finite, Field(gt=0)], Annotated[Finite, Field(gt=0, le=100)]] = Field(
        (0.3, 5.0), description="nearest and farthest depth that its camera measures"
    )


def load_robot(path: Path, text: str | None = None) -> RobotFile:
    """Reads a robot file.

    Args:
        text: what the file is going to hold; None: what it holds now.

    Raises:
        ConfigError: it can't be read or used; the message names the line.
    """
    expected = "a table that begins with `router:`; the file is empty or something else"
    return read_table(path, "robot file", RobotFile, expected, text)[0]


def write_frame(path: Path, T_building_map: PlanarTransform) -> None:
    """Writes where the robot's map lies into its file. All other lines stay as they are.

    Raises:
        ConfigError: the file can't be read or written, or has a form that can't be edited; then it stays as it is.
    """
    path = path.resolve()  # a link stays a link
    try:
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"the robot file can't be read: {error}") from error
    T = T_building_map
    values = {"x_m": round(T.x_m, 4), "y_m": round(T.y_m, 4), "yaw_deg": round(math.degrees(T.yaw_rad), 3)}
    entry = f"T_building_map: {{{', '.join(f'{name}: {value:g}' for name, value in values.items())}}}\n"
    first = next((i for i, line in enumerate(lines) if line.startswith("T_building_map:")), None)
    if first is None:
        if lines and not lines[-1].endswith("\n"):
            lines[-1] += "\n"
        lines.append(entry)
    else:
        end = first + 1
        while end < len(lines) and lines[end][:1] in (" ", "\t"):  # a table over several lines
            end += 1
        lines[first:end] = [entry]
    text = "".join(lines)
    changed = load_robot(path, text).T_building_map
    if changed is None or changed.model_dump() != values:
        raise ConfigError(f"{path}: T_building_map can't be replaced there; write it yourself: {entry.strip()}")
    try:
        with atomic_write(path, keep_mode=True) as out:
            out.write(text.encode())
    except OSError as error:
        raise ConfigError(f"{path} can't be written: {error.strerror}. It is as it was") from error
