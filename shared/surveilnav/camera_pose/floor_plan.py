"""A floor plan with its scale: which place of the building a pixel of its picture shows.

The file is Nav2's ``map.yaml`` (``image``, ``resolution`` [m/px], ``origin`` [x, y, yaw] of the picture's lower left
corner in the map's frame), or a file of our own with the same entries and ``floor``, the floor's id.
Source: https://docs.nav2.org/configuration/packages/configuring-map-server.html
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat
from pydantic_core import ErrorDetails

from surveilnav.errors import ConfigError
from surveilnav.yaml_file import line_of, read_table

_MAX_BYTES = 256 << 20


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """The size and scale of a floor plan's picture.

    Attributes:
        resolution_m: width and height of a pixel.
        origin_m, origin_yaw_rad: pose of the picture's lower left corner in the world; the yaw turns anticlockwise.
        floor: the id of the floor that it shows; empty: the file doesn't say.
        walls: (height, width) bool, the dark pixels; empty if nobody needs them.
        picture: the picture's file, for showing it to people.
    """

    width_px: int
    height_px: int
    resolution_m: float
    origin_m: tuple[float, float] = (0.0, 0.0)
    origin_yaw_rad: float = 0.0
    floor: str = ""
    walls: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((0, 0), bool), compare=False, repr=False)
    picture: Path | None = field(default=None, compare=False)

    def world_of(self, pixels: NDArray[np.floating]) -> NDArray[np.float64]:
        """The places (..., 2) as (x, y) [m] in the world of pixels (..., 2) as (column, row).

        Pixel (0, 0) is the centre of the top left one; rows grow downwards.
        """
        x = (pixels[..., 0] + 0.5) * self.resolution_m
        y = (self.height_px - 0.5 - pixels[..., 1]) * self.resolution_m
        c, s = math.cos(self.origin_yaw_rad), math.sin(self.origin_yaw_rad)
        return np.stack([c * x - s * y, s * x + c * y], axis=-1) + self.origin_m

    def pixels_of(self, p_world: NDArray[np.floating]) -> NDArray[np.float64]:
        """The pixels (..., 2) as (column, row) of places (..., 2 or 3) in the world: the inverse of ``world_of``."""
        dx, dy = p_world[..., 0] - self.origin_m[0], p_world[..., 1] - self.origin_m[1]
        c, s = math.cos(self.origin_yaw_rad), math.sin(self.origin_yaw_rad)
        column = (c * dx + s * dy) / self.resolution_m - 0.5
        row = self.height_px - 0.5 - (c * dy - s * dx) / self.resolution_m
        return np.stack([column, row], axis=-1)


class PlanFile(BaseModel):
    """Entries of a map.yaml that a plan needs; it has others besides."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    image: str = Field(min_length=1)
    resolution: Annotated[FiniteFloat, Field(gt=0, le=10)]
    origin: tuple[FiniteFloat, FiniteFloat] | tuple[FiniteFloat, FiniteFloat, FiniteFloat] = (0.0, 0.0, 0.0)
    negate: bool = False
    occupied_thresh: Annotated[float, Field(gt=0, lt=1)] = 0.65
    floor: str = ""


def load_floor_plan(path: Path) -> FloorPlan:
    """Reads a plan's file and the picture that it names, relative to the file.

    Raises:
        ConfigError: the file or its picture can't be read, or the scale is missing or wrong.
    """
    entry, line = read_plan_file(path, "file of a floor plan", PlanFile)
    picture, pixels = read_plan_picture(path, entry.image, line)
    grey = _grey(pixels)
    darkness = grey / 255.0 if entry.negate else 1.0 - grey / 255.0
    yaw_rad = entry.origin[2] if len(entry.origin) == 3 else 0.0
    return FloorPlan(
        grey.shape[1],
        grey.shape[0],
        entry.resolution,
        (entry.origin[0], entry.origin[1]),
        yaw_rad,
        entry.floor,
        np.asarray(darkness > entry.occupied_thresh),
        picture,
    )


_File = TypeVar("_File", bound=PlanFile)


def read_plan_file(path: Path, what: str, model: type[_File]) -> tuple[_File, int]:
    """The entries of a map.yaml, and the line of its ``image``.

    Args:
        what: what the file is, for messages.

    Raises:
        ConfigError: it can't be read, or has mistakes; the first is named at its line.
    """
    expected = "a table with image, resolution and origin (Nav2's map.yaml)"
    entry, root = read_table(path, what, model, expected, fault=_fault)
    return entry, line_of(root, ("image",))


def _fault(error: ErrorDetails) -> str:
    where = str(error["loc"][0]) if error["loc"] else "the file"
    expected = {
        "image": "the plan's picture, such as `image: ground.png`",
        "resolution": "the plan's scale: how many metres a pixel is wide, such as `resolution: 0.05`. To find it, divide the "
        "length of a wall in metres by its length in pixels",
        "origin": "where the picture's lower left corner lies in the building (x [m], y [m], yaw [rad]), such as "
        "`origin: [-3.5, 0.0, 0.0]`",
    }
    arrived = "is missing" if error["type"] == "missing" else f"is {error['input']!r}, which doesn't fit"
    return f"{where} {arrived}: expected {expected.get(where, error['msg'])}"


def read_plan_picture(plan: Path, image: str, line: int) -> tuple[Path, NDArray[np.uint8]]:
    """The picture that a plan's file names: its path, and its pixels (height, width[, channels]) as OpenCV reads them.

    Args:
        image: its path as the file has it, relative to the file.
        line: where that stands in the file.

    Raises:
        ConfigError: it can't be read, or is too large.
    """
    try:
        path = plan.parent / Path(image).expanduser()
        if not path.is_file():
            raise ConfigError(f"there is no file {path}; its path is relative to {plan.name}")
        return path, read_picture(path)
    except (ConfigError, OSError, ValueError, RuntimeError) as error:  # also no name of a file, or of a user's folder
        raise ConfigError(f"{plan}, line {line}: image: {error}") from None


def read_picture(path: Path) -> NDArray[np.uint8]:
    """The pixels (height, width[, channels]) of a plan's picture as OpenCV reads them. ConfigError: it can't be read."""
    if not path.is_file():
        raise ConfigError(f"there is no file {path}")
    if path.stat().st_size > _MAX_BYTES:
        raise ConfigError(f"{path} has more than {_MAX_BYTES >> 20} MiB")
    try:
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    except cv2.error:  # more pixels than OpenCV reads
        picture = None
    if picture is None:
        raise ConfigError(f"{path} isn't a picture that can be read; save the plan as PNG, PGM or JPEG")
    if picture.dtype == np.uint16:
        picture = (picture >> 8).astype(np.uint8)
    return np.asarray(picture)


def _grey(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(height, width); what is transparent is white."""
    if picture.ndim == 2:
        return picture
    grey = cv2.cvtColor(picture[..., :3], cv2.COLOR_BGR2GRAY)
    return np.asarray(np.where(picture[..., 3] < 128, 255, grey).astype(np.uint8) if picture.shape[2] == 4 else grey)
