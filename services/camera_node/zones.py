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
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from surveilnav.errors import ConfigError

#: Corners (x, y), as fractions of the picture's size.
Polygon = tuple[tuple[float, float], ...]
#: By view, its polygons.
Zones = Mapping[int, Sequence[Polygon]]

_ALL = "all"
_MAX_BYTES, _MAX_ZONES, _MAX_CORNERS = 1 << 20, 100, 100
_MIN_AREA = 1e-9
_SHIFT = 8  # fractional bits of the coordinates that OpenCV gets


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


def masked_pixels(polygons: Sequence[Polygon], width_px: int, height_px: int) -> NDArray[np.bool_]:
    """(height, width): the pixels that a zone touches, even slightly, and one more all around."""
    # The mask has a rim of one pixel, so that parts that rounding moves outside the picture still grow back into it.
    mask = np.zeros((height_px + 2, width_px + 2), np.uint8)
    for polygon in polygons:  # one by one: of several at once OpenCV leaves out the overlap
        # The centre of pixel 0 lies half a pixel inside the picture, behind the rim.
        corners = np.array(polygon) * (width_px, height_px) + 0.5
        cv2.fillPoly(mask, [np.round(corners * (1 << _SHIFT)).astype(np.int32)], 1, shift=_SHIFT)
    return np.asarray(cv2.dilate(mask, np.ones((3, 3), np.uint8))[1:-1, 1:-1] != 0)


# --- the file -------------------------------------------------------------------------------------------------


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
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
    if not isinstance(listed, list) or len(listed) > _MAX_ZONES:
        raise ConfigError(f"{where}: expected a list of at most {_MAX_ZONES} zones, got {_shown(listed)}")
    return [_polygon(zone, f"{where}, zone {i}") for i, zone in enumerate(listed, 1)]


def _polygon(zone: Any, where: str) -> Polygon:
    """The corners of a zone. ConfigError: they don't form a simple polygon inside the picture."""
    if not isinstance(zone, list) or not 3 <= len(zone) <= _MAX_CORNERS:
        raise ConfigError(f"{where}: expected 3 to {_MAX_CORNERS} corners [x, y], got {_shown(zone)}")
    polygon = tuple(_corner(corner, where) for corner in zone)
    if abs(_area(polygon)) < _MIN_AREA:
        raise ConfigError(f"{where}: its corners lie on one line, so that it covers nothing: move one of them aside")
    edges = [*pairwise(polygon), (polygon[-1], polygon[0])]
    for (i, a), (k, b) in combinations(enumerate(edges), 2):
        if 1 < k - i < len(edges) - 1 and _segments_cross(*a, *b):
            raise ConfigError(
                f"{where}: its sides {i + 1} and {k + 1} cross, so that its inside isn't clear: make it two zones"
            )
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


# --- geometry -------------------------------------------------------------------------------------------------

Point = tuple[float, float]


def _area(polygon: Polygon) -> float:
    """Signed area (shoelace)."""
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in [*pairwise(polygon), (polygon[-1], polygon[0])]) / 2


def _segments_cross(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Whether the segments a-b and c-d cross properly: the ends of each lie on different sides of the other."""

    def side(p: Point, q: Point, r: Point) -> float:
        """Its sign says on which side of the line p-q the point r lies."""
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0
