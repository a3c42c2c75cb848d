"""Mask zones: areas of a camera's pictures that nobody is ever shown, and the YAML file that defines them.

    hall:                                  # a camera
      all:                                 # zones of each of its views
        - [[0, 0], [1, 0], [1, 0.1], [0, 0.1]]
      3:                                   # zones of one view
        - [[0.2, 0.5], [0.6, 0.5], [0.4, 0.9]]

A zone is a polygon. Its corners (x, y) are fractions of the picture's width and height, measured from the top left corner of
the top left pixel. A file with any mistake is rejected as a whole: a camera that guessed might show what it must not.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from surveilnav.errors import ConfigError
from surveilnav.geometry.polygon import MAX_CORNERS, MAX_ZONES, Polygon, polygon_fault
from surveilnav.yaml_file import ShallowLoader

#: By view, its polygons.
Zones = Mapping[int, Sequence[Polygon]]

_ALL = "all"
_MAX_BYTES = 1 << 20


def read_zones(
    path: Path, camera: str, n_views: int, cameras: Collection[str] | None = None
) -> dict[int, list[Polygon]]:
    """The zones of a camera by view; views without zones are left out.

    Args:
        path: the file, YAML or JSON.
        camera: name of the camera. The result is empty if the file doesn't mention it.
        n_views: number of its views, which are numbered from 0.
        cameras: names of all cameras of the building, if known. A file that mentions any other is rejected.

    Raises:
        ConfigError: the file can't be read or contains a mistake; the message says where.
    """
    named = _table(_load(path), f"{path}", "cameras")
    if cameras is not None and (unknown := sorted(set(named) - set(cameras))):
        raise ConfigError(f"{path}: there is no camera {unknown[0]!r}; there are {', '.join(sorted(cameras))}")
    zones: dict[int, list[Polygon]] = {}
    for view, listed in _table(named.get(camera, {}), f"{path}: camera {camera}", "views").items():
        where = f"{path}: camera {camera}, view {view}"
        views = range(n_views) if view == _ALL else [_view(view, n_views, where)]
        polygons = _polygons(listed, where)
        for v in views:
            zones.setdefault(v, []).extend(polygons)
    return {v: polygons for v, polygons in sorted(zones.items()) if polygons}


# --- the file -------------------------------------------------------------------------------------------------


class _Loader(ShallowLoader):
    """YAML without duplicate keys: of two, PyYAML would silently drop the first."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [str(self.construct_object(key, deep=True)) for key, _ in node.value]
        if twice := next((k for k in keys if keys.count(k) > 1), None):
            raise yaml.YAMLError(f"{twice!r} stands there twice{node.start_mark}")
        return dict(super().construct_mapping(node, deep))


def _load(path: Path) -> Any:
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise ConfigError(f"{path}: a file of mask zones has at most {_MAX_BYTES} bytes")
        return yaml.load(path.read_text(encoding="utf-8"), _Loader)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"the mask zones of SURVEILNAV_CAMERA__MASKS can't be read: {error}") from error
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise ConfigError(f"{path} isn't YAML: {' '.join(str(error).split())}") from error


def _table(value: Any, where: str, of: str) -> dict[str, Any]:
    """``value``, which must be a mapping. An empty file isn't one: it may have been cut off."""
    if not isinstance(value, dict):
        raise ConfigError(f"{where}: expected a table of {of}, got {_shown(value)}")
    return {str(k): v for k, v in value.items()}


def _view(name: str, n_views: int, where: str) -> int:
    if not (name.isascii() and name.isdigit() and int(name) < n_views):
        raise ConfigError(f"{where}: expected '{_ALL}' or a view of 0-{n_views - 1}")
    return int(name)


def _polygons(listed: Any, where: str) -> list[Polygon]:
    if not isinstance(listed, list) or len(listed) > MAX_ZONES:
        raise ConfigError(f"{where}: expected a list of at most {MAX_ZONES} zones, got {_shown(listed)}")
    return [_polygon(zone, f"{where}, zone {i}") for i, zone in enumerate(listed, 1)]


def _polygon(zone: Any, where: str) -> Polygon:
    """The corners of a zone. ConfigError: they don't form a simple polygon inside the picture."""
    if not isinstance(zone, list) or not 3 <= len(zone) <= MAX_CORNERS:
        raise ConfigError(f"{where}: expected 3 to {MAX_CORNERS} corners [x, y], got {_shown(zone)}")
    polygon = tuple(_corner(corner, where) for corner in zone)
    if fault := polygon_fault(polygon):
        raise ConfigError(f"{where}: {fault}")
    return polygon


def _corner(corner: Any, where: str) -> tuple[float, float]:
    numbers = isinstance(corner, list) and len(corner) == 2 and all(type(v) in (int, float) for v in corner)
    if not numbers or not all(math.isfinite(v) and 0.0 <= v <= 1.0 for v in corner):
        raise ConfigError(
            f"{where}: a corner is [x, y], shares of the picture from 0 (left, top) to 1 (right, bottom); got {_shown(corner)}. "
            "For pixels, divide by the picture's width and height."
        )
    return float(corner[0]), float(corner[1])


def _shown(value: Any) -> str:
    return f"{type(value).__name__} {str(value)[:80]!r}"
