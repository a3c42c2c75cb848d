"""Writes single values into ``cameras.yaml``. Comments, order and all other lines stay as they are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import yaml

from surveilnav.cameras_file.load import load_cameras
from surveilnav.errors import ConfigError
from surveilnav.storage import atomic_write
from surveilnav.yaml_file import compose


def write_camera(path: Path, camera: str, values: Mapping[str, str]) -> None:
    """Replaces values of one camera in a file, all at once or none.

    Args:
        values: by entry, as YAML, such as ``{"position_m": "[1, 2, 3]", "lens.hfov_deg": "96"}``. An entry that isn't
            there yet is added after the one before it in ``values``, so the first must be there.

    Raises:
        ConfigError: the file can't be read or written, or has a form that can't be edited; then it stays as it is.
    """
    path = path.resolve()  # a link stays a link
    try:
        with path.open(encoding="utf-8", newline="") as file:  # lines keep their ends
            text = file.read()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"the file of cameras can't be read: {error}") from error
    changed = edited(path, text, camera, values)
    try:
        with atomic_write(path, keep_mode=True) as out:
            out.write(changed.encode())
    except OSError as error:
        raise ConfigError(f"{path} can't be written: {error.strerror}. It is as it was") from error


def edited(path: Path, text: str, camera: str, values: Mapping[str, str]) -> str:
    """The text of a file after ``write_camera``. ``path`` is for messages.

    Raises:
        ConfigError: as there.
    """
    previous = ""
    for entry, value in values.items():
        node = _camera_node(path, text, camera)
        *above, name = entry.split(".")
        for part in above:
            node = _mapping(path, dict(_items(node)).get(part), part)
        found = dict(_items(node)).get(name)
        if found is not None:
            text = _replaced(path, text, node, name, value)
        else:
            text = _added(path, text, node, previous, f"{name}: {value}")
        previous = name
    problems = [p for p in load_cameras(path, text).problems if p.camera == camera]
    if problems:
        raise ConfigError(f"{path} isn't written, because camera {camera} couldn't be used with it: {problems[0]}")
    return text


def _camera_node(path: Path, text: str, camera: str) -> yaml.MappingNode:
    cameras = dict(_items(_mapping(path, compose(path, "file of cameras", text), "the file"))).get("cameras")
    for node in cameras.value if isinstance(cameras, yaml.SequenceNode) else []:
        if isinstance(node, yaml.MappingNode) and getattr(dict(_items(node)).get("name"), "value", None) == camera:
            return node
    raise ConfigError(f"{path}: there is no camera {camera!r}")


def _mapping(path: Path, node: yaml.Node | None, name: str) -> yaml.MappingNode:
    if not isinstance(node, yaml.MappingNode):
        raise ConfigError(f"{path}: {name}: expected a table")
    return node


def _items(node: yaml.MappingNode) -> list[tuple[str, yaml.Node]]:
    return [(key.value, value) for key, value in node.value]


def _replaced(path: Path, text: str, node: yaml.MappingNode, name: str, value: str) -> str:
    key, old = next((k, v) for k, v in node.value if k.value == name)
    start, end = old.start_mark.index, old.end_mark.index
    # The value of an alias (*name) stands elsewhere, and that of a block list ends where the next entry begins.
    if start < key.end_mark.index or text[key.end_mark.index : start].strip() != ":":
        raise ConfigError(_by_hand(path, key.start_mark.line + 1, name, value))
    if isinstance(old, yaml.CollectionNode) and not old.flow_style:
        raise ConfigError(_by_hand(path, key.start_mark.line + 1, name, value))
    return text[:start] + value + text[end:]


def _added(path: Path, text: str, node: yaml.MappingNode, after: str, line: str) -> str:
    """Adds an entry after another one: on a line of its own, or in the same pair of braces."""
    key, old = next(((k, v) for k, v in node.value if k.value == after), (None, None))
    if key is None or old is None:
        raise ConfigError(_by_hand(path, node.start_mark.line + 1, *line.split(": ", 1)))
    end = old.end_mark.index
    if node.flow_style:
        return f"{text[:end]}, {line}{text[end:]}"
    newline = "\r\n" if "\r\n" in text else "\n"
    line_end = text.find("\n", end)
    if line_end < 0:
        return f"{text}{newline}{' ' * key.start_mark.column}{line}"
    return f"{text[: line_end + 1]}{' ' * key.start_mark.column}{line}{newline}{text[line_end + 1 :]}"


def _by_hand(path: Path, line: int, name: str, value: str) -> str:
    return (
        f"{path}, line {line}: {name} is written in a form that can't be edited; change it to `{name}: {value}` by hand"
    )
