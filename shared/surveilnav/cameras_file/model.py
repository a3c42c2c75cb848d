"""What ``cameras.yaml`` may say. The models' JSON schema is the published one (``surveilnav cameras schema``)."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from surveilnav.contract import ID_PATTERN
from surveilnav.file_entry import Corners, Entry, Finite
from surveilnav.geometry import Matrix4, Pinhole, camera_pose
from surveilnav.geometry.lens import BrownConrady, KannalaBrandt, Lens
from surveilnav.geometry.polygon import MAX_ZONES

Share = Annotated[float, Field(ge=0, le=1)]


class FloorEntry(Entry):
    """One floor of the building."""

    z_m: Finite = Field(description="altitude of the floor's surface [m] in the building's frame")
    rooms: Annotated[
        dict[Annotated[str, Field(min_length=1, max_length=100)], Corners[Finite]], Field(max_length=200)
    ] = Field(
        {},
        description="outlines of rooms by their names for people: corners (x, y) [m] in the building's frame. Answers name "
        "the room in which something was seen, and the rooms that no camera sees",
    )


class LensEntry(Entry):
    """The lens, for pictures of ``width_px`` x ``height_px`` as they come from the stream."""

    model: Literal["pinhole", "fisheye"] = Field(
        "pinhole",
        description="`pinhole`: an ordinary lens with Brown-Conrady distortion (ROS: plumb_bob, rational_polynomial); "
        "`fisheye`: Kannala-Brandt (ROS: equidistant)",
    )
    width_px: int = Field(ge=64, le=16384)
    height_px: int = Field(ge=64, le=16384)
    hfov_deg: Annotated[Finite, Field(gt=1, lt=360)] | None = Field(
        None, description="horizontal field of view by the maker's data sheet; give this or `focal_px`"
    )
    focal_px: tuple[Annotated[Finite, Field(gt=0)], Annotated[Finite, Field(gt=0)]] | None = Field(
        None, description="focal lengths fx, fy from a calibration"
    )
    centre_px: tuple[Finite, Finite] | None = Field(
        None,
        description="principal point cx, cy; (0, 0) is the centre of the first pixel. Default: the picture's middle",
    )
    distortion: list[Finite] = Field(
        [], description="pinhole: k1, k2, p1, p2[, k3[, k4, k5, k6]] as in OpenCV; fisheye: k1 to k4"
    )

    @model_validator(mode="after")
    def _consistent(self) -> LensEntry:
        if (self.hfov_deg is None) == (self.focal_px is None):
            raise ValueError("expected either hfov_deg (from the data sheet) or focal_px (from a calibration)")
        if self.model == "pinhole" and self.hfov_deg is not None and self.hfov_deg >= 170:
            raise ValueError(f"a pinhole lens sees less than 170 degrees, got {self.hfov_deg:g}: use `model: fisheye`")
        if self.centre_px is not None:
            cx, cy = self.centre_px
            if not (0 <= cx < self.width_px and 0 <= cy < self.height_px):
                raise ValueError(f"the principal point ({cx:g}, {cy:g}) lies outside the picture")
        self.lens()  # raises ValueError if the number of coefficients is wrong
        return self

    def lens(self) -> Lens:
        """The lens that this describes."""
        cx, cy = self.centre_px or ((self.width_px - 1) / 2, (self.height_px - 1) / 2)
        fx, fy = self.focal_px or (self._focal_px(),) * 2
        pinhole = Pinhole(self.width_px, self.height_px, fx, fy, cx, cy)
        if self.model == "pinhole":
            return BrownConrady(pinhole, tuple(self.distortion))
        return KannalaBrandt(pinhole, tuple(self.distortion))

    def _focal_px(self) -> float:
        """The focal length with which the middle row shows ``hfov_deg``; undistorted if the lens is an ordinary one."""
        half_rad = math.radians(self.hfov_deg or 0.0) / 2
        if self.model == "pinhole":
            return self.width_px / (2 * math.tan(half_rad))
        k = (*self.distortion, *([0.0] * 4))[:4]
        return self.width_px / (2 * half_rad * (1 + sum(c * half_rad ** (2 * i + 2) for i, c in enumerate(k))))


class CameraEntry(Entry):
    """One camera."""

    name: str = Field(pattern=ID_PATTERN, description="its name on the bus: letters, digits, `_`, `.`, `-`")
    label: str = Field("", max_length=100, description="its name for people, in any writing; default: `name`")
    floor: str = Field(pattern=ID_PATTERN, description="the floor that it looks at, one of `floors`")
    stream: str = Field(
        min_length=1,
        description="rtsp://, rtsps://, http:// or https:// (MJPEG, or a single picture), usb:0 or /dev/video0, or the path of a "
        "video file or a folder of pictures, relative to this file. ${NAME} is taken from the environment",
    )
    position_m: tuple[Finite, Finite, Finite] = Field(description="(x, y, z) of the lens in the building's frame")
    yaw_deg: Finite = Field(
        description="direction, anticlockwise from +x; of a camera that looks down: of the picture's top"
    )
    pitch_deg: Annotated[Finite, Field(ge=-90, le=90)] = Field(0.0, description="negative: it looks down")
    roll_deg: Annotated[Finite, Field(ge=-180, le=180)] = Field(
        0.0, description="turns the camera clockwise about its axis"
    )
    lens: LensEntry
    views: Literal["single", "around"] = Field(
        "single",
        description="`single`: one view in the camera's direction; `around`: twelve views all around and one straight down, "
        "for a fisheye on a ceiling. Those that the lens doesn't see are left out",
    )
    view_hfov_deg: Annotated[Finite, Field(ge=20, le=120)] | None = Field(
        None, description="horizontal field of view of each view; default: the lens's, at most 100"
    )
    max_width_px: int = Field(640, ge=64, le=4096, description="width of the pictures that it sends")
    max_hz: float = Field(1.0, gt=0, le=30, description="pictures a second that it sends, at most")
    zones: list[Corners[Share]] = Field(
        [],
        max_length=MAX_ZONES,
        description="polygons that nobody is ever shown; corners (x, y) as shares of the stream's width and height",
    )

    def pose(self) -> Matrix4:
        """``T_world_camera`` (4, 4) of the lens, OpenCV axes."""
        T = camera_pose(self.position_m, math.radians(self.yaw_deg), math.radians(self.pitch_deg))
        c, s = math.cos(math.radians(self.roll_deg)), math.sin(math.radians(self.roll_deg))
        T[:3, :3] = T[:3, :3] @ [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
        return T


class FileModel(Entry):
    """The file of a building's real cameras, ``cameras.yaml``."""

    building: str = Field("", description="the building's name, for people")
    floors: dict[Annotated[str, Field(pattern=ID_PATTERN)], FloorEntry]
    cameras: list[CameraEntry]
