"""The file of sightings: at which pixels each camera saw the tag's corners, and where the robot said it stood."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, FiniteFloat

from surveilnav.camera_pose.tag.detection import TAGS
from surveilnav.contract import ID_PATTERN
from surveilnav.errors import ConfigError
from surveilnav.file_entry import Entry
from surveilnav.storage import atomic_write
from surveilnav.yaml_file import line_of, read_table

_Id = Annotated[str, Field(pattern=ID_PATTERN)]
_Pixel = tuple[FiniteFloat, FiniteFloat]
_Corners = tuple[_Pixel, _Pixel, _Pixel, _Pixel]


class Tag(Entry):
    """The tag that the robot carries."""

    id: int = Field(0, ge=0, lt=TAGS, description="number of the tag in the family 36h11")
    size_m: Annotated[FiniteFloat, Field(gt=0.01, le=2)] = Field(description="side of the black square [m]")
    height_m: Annotated[FiniteFloat, Field(ge=0, le=5)] = Field(description="the tag's centre above the floor [m]")


class StopEntry(Entry):
    """A place where the robot stood still, and the corners that cameras saw meanwhile."""

    robot: _Id
    floor: _Id
    xy_m: tuple[FiniteFloat, FiniteFloat] = Field(description="the robot's place in the building's frame, as it said")
    yaw_deg: FiniteFloat = Field(description="its direction, anticlockwise from +x")
    seen: dict[_Id, _Corners] = Field(
        description="by camera: (u, v) of the black square's corners in its picture, clockwise from the pattern's top left"
    )


class SightingsFile(Entry):
    """The file of sightings."""

    tag: Tag
    stops: list[StopEntry] = Field([], max_length=10_000)


@dataclass(slots=True)
class Stop:
    """A place where the robot stood still. ``seen``: (4, 2) pixels of the corners by camera. ``line``: in the file; 0: new."""

    robot: str
    floor: str
    x_m: float
    y_m: float
    yaw_rad: float
    seen: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    line: int = 0


@dataclass(slots=True)
class Sightings:
    """All sightings of a tag. Stop number 1 is the first one."""

    tag: Tag
    stops: list[Stop] = field(default_factory=list)

    def count(self, camera: str) -> int:
        """At how many stops a camera saw the tag."""
        return sum(camera in stop.seen for stop in self.stops)


def load_sightings(path: Path) -> Sightings:
    """Reads a file of sightings.

    Raises:
        ConfigError: it can't be read or has mistakes; each is named at its line.
    """
    expected = "a table with tag and stops; the file is empty or something else"
    entry, root = read_table(path, "file of sightings", SightingsFile, expected, max_faults=20)
    stops = [
        Stop(
            stop.robot,
            stop.floor,
            *stop.xy_m,
            math.radians(stop.yaw_deg),
            {camera: np.array(corners) for camera, corners in stop.seen.items()},
            line_of(root, ("stops", i)),
        )
        for i, stop in enumerate(entry.stops)
    ]
    return Sightings(entry.tag, stops)


def save_sightings(path: Path, sightings: Sightings) -> None:
    """Writes a file of sightings, a line a stop; the file is replaced as a whole.

    Raises:
        ConfigError: it can't be written.
    """
    tag = sightings.tag
    lines = [f"tag: {{id: {tag.id}, size_m: {tag.size_m:g}, height_m: {tag.height_m:g}}}"]
    lines.append("stops:" if sightings.stops else "stops: []")
    lines += [f"  - {_line(stop)}" for stop in sightings.stops]
    try:
        with atomic_write(path) as out:
            out.write(("\n".join(lines) + "\n").encode())
    except OSError as error:
        raise ConfigError(f"{path} can't be written: {error.strerror}") from error


def _line(stop: Stop) -> str:
    seen = {
        camera: [[round(float(x), 3) for x in corner] for corner in corners] for camera, corners in stop.seen.items()
    }
    # JSON's quoted strings are YAML, too: a camera's name may look like a number
    shown = ", ".join(f"{json.dumps(camera)}: {corners}" for camera, corners in seen.items())
    return (
        f"{{robot: {json.dumps(stop.robot)}, floor: {json.dumps(stop.floor)}, xy_m: [{stop.x_m:.4f}, {stop.y_m:.4f}], "
        f"yaw_deg: {math.degrees(stop.yaw_rad):.3f}, seen: {{{shown}}}}}"
    )
