"""Reads ``cameras.yaml``. Every mistake is named at its line; a mistake in one camera leaves the other cameras usable."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from pydantic import TypeAdapter, ValidationError

from surveilnav.cameras_file.model import CameraEntry, FloorEntry
from surveilnav.contract import ID_PATTERN
from surveilnav.errors import ConfigError
from surveilnav.yaml_file import compose, line_of, plain

_TOP = ("building", "floors", "cameras")
_FLOORS = TypeAdapter(dict[str, FloorEntry])


@dataclass(frozen=True, slots=True)
class Problem:
    """A mistake in the file. ``camera``: the camera that can't be used because of it; empty: none could be told."""

    line: int
    camera: str
    message: str

    def __str__(self) -> str:
        return f"line {self.line}: {f'camera {self.camera}: ' if self.camera else ''}{self.message}"


@dataclass(frozen=True, slots=True)
class CamerasFile:
    """The usable part of a file, and its mistakes.

    Attributes:
        cameras: by name, those without a mistake.
    """

    path: Path
    building: str = ""
    floors: dict[str, FloorEntry] = field(default_factory=dict)
    cameras: dict[str, CameraEntry] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()


def load_cameras(path: Path, text: str | None = None) -> CamerasFile:
    """Reads a file of cameras.

    Args:
        text: what the file is going to hold; None: what it holds now.

    Raises:
        ConfigError: nothing in it can be used: it can't be read, isn't YAML, or its table of floors is wrong.
    """
    root = compose(path, "file of cameras", text)
    if not isinstance(root, yaml.MappingNode):
        raise ConfigError(f"{path}: expected a table with {', '.join(_TOP)}; the file is empty or something else")
    parts = {key.value: value for key, value in root.value}
    problems = [
        Problem(key.start_mark.line + 1, "", f"unknown entry {key.value!r}; expected {', '.join(_TOP)}")
        for key, _ in root.value
        if key.value not in _TOP
    ]
    floors = _floors(path, parts.get("floors"))
    building = _building(path, parts.get("building"))
    cameras: dict[str, CameraEntry] = {}
    listed = parts.get("cameras")
    if not isinstance(listed, yaml.SequenceNode):
        raise ConfigError(f"{path}: expected `cameras:` with a list of cameras, each beginning with `- name:`")
    names = [_name(node) for node in listed.value]
    for node, name in zip(listed.value, names, strict=True):
        if name and names.count(name) > 1:
            lines = [str(n.start_mark.line + 1) for n, other in zip(listed.value, names, strict=True) if other == name]
            message = f"several cameras have this name (lines {', '.join(lines)}): give each its own"
            problems.append(Problem(node.start_mark.line + 1, name, message))
            continue
        found = _camera(node, floors)
        if isinstance(found, CameraEntry):
            cameras[found.name] = found
        else:
            problems.extend(found)
    return CamerasFile(path, building, floors, cameras, tuple(sorted(problems, key=lambda p: p.line)))


def _building(path: Path, node: yaml.Node | None) -> str:
    try:
        return str((node and plain(node)) or "")
    except ValueError as error:
        raise ConfigError(f"{path}: building: {error}") from None


def _name(node: yaml.Node) -> str:
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            if key.value == "name" and isinstance(value, yaml.ScalarNode):
                return str(value.value)
    return ""


def _floors(path: Path, node: yaml.Node | None) -> dict[str, FloorEntry]:
    if node is None:
        raise ConfigError(f"{path}: expected `floors:` with the altitude of each floor, such as `ground: {{z_m: 0.0}}`")
    try:
        floors = _FLOORS.validate_python(plain(node))
    except ValidationError as error:
        first = error.errors()[0]
        line = line_of(node, first["loc"])
        raise ConfigError(f"{path}, line {line}: floors: {_sentence(first)}") from None
    except ValueError as error:
        raise ConfigError(f"{path}: floors: {error}") from None
    return floors


def _camera(node: yaml.Node, floors: dict[str, FloorEntry]) -> CameraEntry | list[Problem]:
    name, line = _name(node), node.start_mark.line + 1
    try:
        entry = CameraEntry.model_validate(plain(node))
    except ValidationError as error:
        return [Problem(line_of(node, e["loc"]), name, _sentence(e)) for e in error.errors()]
    except ValueError as error:
        return [Problem(line, name, str(error))]
    if entry.floor not in floors:
        known = ", ".join(floors)
        return [
            Problem(line_of(node, ("floor",)), name, f"floor: there is no floor {entry.floor!r}; there are {known}")
        ]
    height_m = entry.position_m[2] - floors[entry.floor].z_m
    if not 0.2 <= height_m <= 30.0:
        message = (
            f"position_m: the camera is {height_m:.2f} m above its floor; expected 0.2 to 30 m. "
            "z is measured in the building's frame, as z_m of the floor is"
        )
        return [Problem(line_of(node, ("position_m",)), name, message)]
    return entry


def _sentence(error: Any) -> str:
    """What is wrong, without the value: it may be an address with a password."""
    where = ".".join(str(part) for part in error["loc"] if not str(part).startswith("function-"))
    if where == "name" and error["type"] == "string_pattern_mismatch":
        return f"name: expected letters, digits, '_', '.', '-' ({ID_PATTERN}); other writing belongs to `label`"
    message = str(error["msg"]).removeprefix("Value error, ")
    return f"{where}: {message}" if where else message
