"""Floor plans and Nav2's maps that answers name. What lies outside the building's folder is copied into it."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from pathlib import Path

from surveilnav.camera_pose import load_floor_plan
from surveilnav.camera_pose.floor_plan import PlanFile, read_picture, read_plan_file
from surveilnav.cli.building_setup.answers import FloorAnswers
from surveilnav.errors import ConfigError
from surveilnav.robot_file import FrameEntry
from surveilnav.robot_frame.nav2_map import load_nav2_map

_YAML = (".yaml", ".yml")


@dataclass(frozen=True, slots=True)
class FloorFiles:
    """The files of a floor.

    Attributes:
        plan, nav2_map: their ``.yaml``, relative to the building's folder; empty: there is none.
        T_building_map: where the origin of ``nav2_map`` lies; None: that isn't known yet.
        written: files to write, relative to the folder.
    """

    plan: str = ""
    nav2_map: str = ""
    T_building_map: FrameEntry | None = None
    written: dict[str, bytes] = field(default_factory=dict)


def has_scale(plan: Path) -> bool:
    """Whether a plan says its own scale, as a map.yaml does."""
    return plan.suffix.lower() in _YAML


def check_plan(plan: Path) -> None:
    """Raises ConfigError if a plan can't be read."""
    if has_scale(plan):
        load_floor_plan(plan)
    else:
        read_picture(plan)


def files_of_floor(name: str, floor: FloorAnswers, base: Path, folder: Path) -> FloorFiles:
    """The files of a floor.

    Args:
        base: where relative paths of the answers begin.
        folder: the building's, which need not be there yet.

    Raises:
        ConfigError: a plan or map can't be read, or its scale isn't given.
    """
    written: dict[str, bytes] = {}
    nav2_map, plan, T_building_map = "", "", floor.T_building_map
    if floor.nav2_map:
        load_nav2_map(base / floor.nav2_map)
        nav2_map = _with_picture(base / floor.nav2_map, folder, f"maps/{name}", written)
    if floor.plan and floor.nav2_map and _same(base / floor.plan, base / floor.nav2_map):
        plan, T_building_map = nav2_map, T_building_map or FrameEntry(x_m=0, y_m=0, yaw_deg=0)
    elif floor.plan and has_scale(floor.plan):
        load_floor_plan(base / floor.plan)
        plan = _with_picture(base / floor.plan, folder, f"plans/{name}", written)
    elif floor.plan:
        plan = _with_scale(name, base / floor.plan, floor.plan_width_m, folder, written)
    return FloorFiles(plan, nav2_map, T_building_map, written)


def _same(a: Path, b: Path) -> bool:
    return a.resolve() == b.resolve()


def _inside(path: Path, folder: Path) -> str:
    """The path relative to the folder; empty if it isn't below it."""
    path, folder = path.resolve(), folder.resolve()
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else ""


def _with_picture(path: Path, folder: Path, to: str, written: dict[str, bytes]) -> str:
    """The place of a map.yaml in the folder: where it is, or else where it and its picture are copied to."""
    entry, line = read_plan_file(path, "map", PlanFile)
    picture = path.parent / Path(entry.image).expanduser()
    if (here := _inside(path, folder)) and _inside(picture, folder):
        return here
    name = f"{Path(to).name}{picture.suffix.lower()}"
    text, n = re.subn(r"^image:.*$", f"image: {name}", path.read_text(encoding="utf-8"), count=1, flags=re.MULTILINE)
    if not n:
        raise ConfigError(f"{path}, line {line}: image: lay the file and its picture into {folder} yourself")
    written[f"{to}.yaml"] = text.encode()
    written[str(Path(to).with_name(name))] = picture.read_bytes()
    return f"{to}.yaml"


def _with_scale(name: str, picture: Path, width_m: float | None, folder: Path, written: dict[str, bytes]) -> str:
    """Writes a plan's ``.yaml``, beside a copy of its picture unless that lies in the folder."""
    width_px = read_picture(picture).shape[1]
    if width_m is None:
        raise ConfigError(
            f"floor {name}: plan_width_m is missing: how many metres wide is what {picture} shows, from its left to its right "
            "edge?"
        )
    if here := _inside(picture, folder):
        image = os.path.relpath(here, "plans")
    else:
        image = f"{name}{picture.suffix.lower()}"
        written[f"plans/{image}"] = picture.read_bytes()
    written[f"plans/{name}.yaml"] = (
        f"image: {image}\n"
        f"resolution: {width_m / width_px:.6g}   # metres per pixel: {width_m:g} m / {width_px} px\n"
        "origin: [0.0, 0.0, 0.0]   # the building's origin is the picture's lower left corner\n"
        f"floor: '{name}'\n"
    ).encode()
    return f"plans/{name}.yaml"
