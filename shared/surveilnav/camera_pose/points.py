"""The file of clicks: points in a camera's picture whose places in the building are known."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, FiniteFloat, model_validator
from pydantic_core import ErrorDetails

from surveilnav.camera_pose.floor_plan import FloorPlan, load_floor_plan
from surveilnav.contract import ID_PATTERN
from surveilnav.errors import ConfigError
from surveilnav.file_entry import Entry
from surveilnav.storage import atomic_write
from surveilnav.yaml_file import line_of, read_table

#: Of a file.
MAX_POINTS = 500


class ClickedPoint(Entry):
    """A point that was clicked in the picture, and where it is in the building."""

    px: tuple[FiniteFloat, FiniteFloat] = Field(
        description="(u, v) in the camera's picture as it comes from the stream"
    )
    plan_px: tuple[FiniteFloat, FiniteFloat] | None = Field(
        None, description="(column, row) in the plan's picture; or `xy_m`"
    )
    xy_m: tuple[FiniteFloat, FiniteFloat] | None = Field(
        None, description="(x, y) [m] in the building's frame; or `plan_px`"
    )
    z_m: Annotated[FiniteFloat, Field(ge=-20, le=50)] = Field(0.0, description="height above the camera's floor [m]")

    @model_validator(mode="after")
    def _one_place(self) -> ClickedPoint:
        if (self.plan_px is None) == (self.xy_m is None):
            raise ValueError("expected its place once: either plan_px (on the plan) or xy_m (in metres)")
        return self


class ClicksFile(Entry):
    """The file of one camera's clicks."""

    camera: str = Field(pattern=ID_PATTERN, description="the camera's name in cameras.yaml")
    plan: str = Field("", description="path of the plan's file (map.yaml), relative to this file")
    points: list[ClickedPoint] = Field(min_length=1, max_length=MAX_POINTS)


@dataclass(frozen=True, eq=False)
class Clicks:
    """Clicks with their places. Point number 1 is the first of the file.

    Attributes:
        pixels: (n, 2), (u, v) in the camera's picture.
        p_floor: (n, 3), x and y in the building's frame, z above the camera's floor [m].
        lines: of the file, for each point.
        plan: the plan that the file names.
    """

    camera: str
    pixels: NDArray[np.float64]
    p_floor: NDArray[np.float64]
    lines: tuple[int, ...]
    plan: FloorPlan | None = None


def load_clicks(path: Path) -> Clicks:
    """Reads a file of clicks, and the plan that it names.

    Raises:
        ConfigError: one of the two can't be read, or has a mistake; all mistakes of the clicks are named, each at its line.
    """
    expected = "a table with camera, plan and points; the file is empty or something else"
    entry, root = read_table(path, "file of clicks", ClicksFile, expected, fault=_fault, max_faults=None)
    lines = tuple(line_of(root, ("points", i)) for i in range(len(entry.points)))
    plan = load_floor_plan(_plan_path(path, entry.plan)) if entry.plan else None
    places = []
    for number, (point, line) in enumerate(zip(entry.points, lines, strict=True), start=1):
        places.append((*_place(point, plan, f"{path}, line {line}: point {number}"), point.z_m))
    return Clicks(entry.camera, np.array([p.px for p in entry.points]), np.array(places), lines, plan)


def _plan_path(path: Path, plan: str) -> Path:
    """Where the plan is that a file of clicks names."""
    try:
        return path.parent / Path(plan).expanduser()
    except RuntimeError as error:  # no user of that name has a folder
        raise ConfigError(f"{path}: plan: {error}") from None


def save_clicks(path: Path, clicks: ClicksFile) -> None:
    """Writes a file of clicks, which replaces the one that is there.

    Raises:
        ConfigError: it can't be written; then the old one is as it was.
    """
    lines = [f"camera: {clicks.camera}"]
    if clicks.plan:
        lines.append(f"plan: {json.dumps(clicks.plan, ensure_ascii=False)}  # relative to this file")
    lines.append("points:")
    for point in clicks.points:
        u, v = point.px
        name, digits, place = ("plan_px", 2, point.plan_px) if point.xy_m is None else ("xy_m", 4, point.xy_m)
        x, y = place or (0.0, 0.0)
        height = f", z_m: {point.z_m:g}" if point.z_m else ""
        lines.append(f"  - {{px: [{u:.2f}, {v:.2f}], {name}: [{x:.{digits}f}, {y:.{digits}f}]{height}}}")
    try:
        with atomic_write(path) as out:
            out.write(("\n".join(lines) + "\n").encode())
    except OSError as error:
        raise ConfigError(f"{path} can't be written: {error.strerror}") from error


def _place(point: ClickedPoint, plan: FloorPlan | None, where: str) -> tuple[float, float]:
    if point.xy_m is not None:
        return point.xy_m
    if plan is None:
        raise ConfigError(f"{where}: plan_px needs a plan: add `plan: map.yaml` at the top, or write xy_m in metres")
    column, row = point.plan_px or (0.0, 0.0)
    if not (-0.5 <= column <= plan.width_px - 0.5 and -0.5 <= row <= plan.height_px - 0.5):
        size = f"{plan.width_px} x {plan.height_px}"
        raise ConfigError(f"{where}: plan_px ({column:g}, {row:g}) lies outside the plan's picture of {size} pixels")
    x, y = plan.world_of(np.array([column, row]))
    return float(x), float(y)


def _fault(error: ErrorDetails) -> str:
    loc = error["loc"]
    where = f"point {int(loc[1]) + 1}: " if len(loc) > 1 and loc[0] == "points" else ""
    name = ".".join(str(part) for part in (loc[2:] if where else loc))
    message = error["msg"].removeprefix("Value error, ")
    return f"{where}{name}: {message}" if name else f"{where}{message}"
