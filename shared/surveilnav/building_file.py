"""``building.yaml``: what a building consists of, and what is known of its floors before anything has seen them.

It names the files of the cameras and of the robots. Floors are those of the cameras' file, which says how high they lie.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from surveilnav.contract import ID_PATTERN
from surveilnav.file_entry import Corners, Entry
from surveilnav.messages.area import MAX_ENTRIES, MAX_M, MAX_NAME
from surveilnav.robot_file import FrameEntry
from surveilnav.yaml_file import read_table


def _in_reach(value: float) -> float:
    if not math.isfinite(value) or abs(value) > MAX_M:
        raise ValueError(f"expected a finite number of at most {MAX_M:g} metres")
    return value


Metres = Annotated[float, AfterValidator(_in_reach)]
_Label = Annotated[str, Field(min_length=1, max_length=MAX_NAME)]
_Id = Annotated[str, Field(pattern=ID_PATTERN)]


class PassageEntry(Entry):
    """A door or a lift that robots pass."""

    kind: Literal["door", "lift"] = "door"
    outline_m: Corners[Metres] = Field(
        description="corners (x, y) [m] in the building's frame of the place that robots pass only while it is open"
    )


class BuildingFloor(Entry):
    """What is known of a floor before anything has seen it."""

    plan: Path | None = Field(
        None, description="a picture of its floor plan, or a `.yaml` that says its scale as Nav2's does"
    )
    nav2_map: Path | None = Field(
        None, description="Nav2's map of it, a `map.yaml`: walls and free space that are known"
    )
    T_building_map: FrameEntry | None = Field(None, description="where the origin of `nav2_map` lies in the building")
    keepout: Annotated[dict[_Label, Corners[Metres]], Field(max_length=MAX_ENTRIES)] = Field(
        {}, description="outlines of places where no robot is sent, by their names for people: corners (x, y) [m]"
    )
    passages: Annotated[dict[_Id, PassageEntry], Field(max_length=MAX_ENTRIES)] = Field(
        {}, description="doors and lifts by their names in the system that opens them"
    )

    @model_validator(mode="after")
    def _placed(self) -> BuildingFloor:
        if (self.nav2_map is None) != (self.T_building_map is None):
            raise ValueError(
                "nav2_map needs T_building_map beside it, which says where the map lies, and the other way round"
            )
        return self


class BuildingFile(Entry):
    """One building. Paths are relative to the file."""

    building: _Label = Field(description="its name for people")
    cameras: Path = Field(Path("cameras.yaml"), description="the file of its cameras, which also names its floors")
    robots: Annotated[dict[_Id, Path], Field(max_length=MAX_ENTRIES)] = Field(
        {}, description="files of its robots, by their ids"
    )
    floors: Annotated[dict[_Id, BuildingFloor], Field(max_length=MAX_ENTRIES)] = Field(
        {}, description="floors of which more is known than their altitude"
    )


def load_building(path: Path, text: str | None = None) -> BuildingFile:
    """Reads a building file. Its paths come out absolute; whether they lead to files isn't looked at.

    Args:
        text: what the file is going to hold; None: what it holds now.

    Raises:
        ConfigError: it can't be read or used; the message names the line.
    """
    expected = "a table that begins with `building:`; the file is empty or something else"
    read, _ = read_table(path, "building file", BuildingFile, expected, text)
    return _with_absolute_paths(read, path.resolve().parent)


def _with_absolute_paths(read: BuildingFile, folder: Path) -> BuildingFile:
    floors = {
        name: floor.model_copy(
            update={
                "plan": folder / floor.plan if floor.plan else None,
                "nav2_map": folder / floor.nav2_map if floor.nav2_map else None,
            }
        )
        for name, floor in read.floors.items()
    }
    robots = {name: folder / file for name, file in read.robots.items()}
    return read.model_copy(update={"cameras": folder / read.cameras, "robots": robots, "floors": floors})
