"""Mask zones: stretches of a camera's pictures that nobody is ever shown, and the file that names them.

    hall:                                  # a camera
      all:                                 # each of its views ...
        - [[0, 0], [1, 0], [1, 0.1], [0, 0.1]]
      3:                                   # ... or one of them
        - [[0.2, 0.5], [0.6, 0.5], [0.4, 0.9]]

A zone is a polygon. Its corners (x, y) are shares of the picture's width and height, from the top left corner of its top left
pixel. A file that says anything that can't be meant is refused whole: a camera that guessed would show what it must not.
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

#: Corners (x, y), each a share of the picture.
Polygon = tuple[tuple[float, float], ...]
Zones = Mapping[int, Sequence[Polygon]]

_ALL = "all"
_MOST_BYTES, _MOST_ZONES, _MOST_CORNERS = 1 << 20, 100, 100
_FLAT = 1e-9
_SHIFT = 8  # bits below a pixel, for OpenCV


def read_zones(
    path: Path, camera: str, n_views: int, cameras: Collection[str] | None = None
) -> dict[int, list[Polygon]]:
    """The zones of a camera by view; views without any are left out.

    Args:
        path: the file, YAML or JSON.
        camera: whose zones are wanted; none are if the file doesn't name it.
        n_views: how many views it has, numbered from 0.
        cameras: all cameras that there are, if that is known: the file may name no other.

    Raises:
        ConfigError: the file can't be read, or holds what can't be meant.
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
    """(height, width): which pixels a zone touches, however little; a pixel more all around rather than one less."""
    # With a rim: what is drawn outside the picture, by rounding at its edge, still grows into it.
    mask = np.zeros((height_px + 2, width_px + 2), np.uint8)
    for polygon in polygons:  # one by one: together, OpenCV would leave out where two overlap
        # The centre of pixel 0 lies half a pixel inside the picture, behind the rim.
        corners = np.array(polygon) * (width_px, height_px) + 0.5
        cv2.fillPoly(mask, [np.round(corners * (1 << _SHIFT)).astype(np.int32)], 1, shift=_SHIFT)
    return np.asarray(cv2.dilate(mask, np.ones((3, 3), np.uint8))[1:-1, 1:-1] != 0)


# --- the file -------------------------------------------------------------------------------------------------


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """YAML in which nothing is said twice: the second would silently take the place of the first."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [str(self.construct_object(key, deep=True)) for key, _ in node.value]
        if twice := next((k for k in keys if keys.count(k) > 1), None):
            raise yaml.YAMLError(f"{twice!r} stands there twice{node.start_mark}")
        return dict(super().construct_mapping(node, deep))


def _load(path: Path) -> Any:
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ConfigError(f"{path}: a file of mask zones has at most {_MOST_BYTES} bytes")
        return yaml.load(
            path.read_text(encoding="utf-8"), _Loader
        )  # an empty file is no table: it may have been cut off
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"the mask zones of SURVEILNAV_CAMERA__MASKS can't be read: {error}") from error
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise ConfigError(f"{path} isn't YAML: {' '.join(str(error).split())}") from error


def _table(value: Any, where: str, of: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ConfigError(f"{where}: expected a table of {of}, got {_shown(value)}")
    return {str(k): v for k, v in value.items()}


def _view(name: str, n_views: int, where: str) -> int:
    if not (name.isascii() and name.isdigit() and int(name) < n_views):
        raise ConfigError(f"{where}: expected '{_ALL}' or a view of 0-{n_views - 1}")
    return int(name)


def _polygons(listed: Any, where: str) -> list[Polygon]:
    if not isinstance(listed, list) or len(listed) > _MOST_ZONES:
        raise ConfigError(f"{where}: expected a list of at most {_MOST_ZONES} zones, got {_shown(listed)}")
    return [_polygon(zone, f"{where}, zone {i}") for i, zone in enumerate(listed, 1)]


def _polygon(zone: Any, where: str) -> Polygon:
    """A zone's corners. ConfigError: they make no polygon, or not one inside the picture."""
    if not isinstance(zone, list) or not 3 <= len(zone) <= _MOST_CORNERS:
        raise ConfigError(f"{where}: expected 3 to {_MOST_CORNERS} corners [x, y], got {_shown(zone)}")
    polygon = tuple(_corner(corner, where) for corner in zone)
    if abs(_area(polygon)) < _FLAT:
        raise ConfigError(f"{where}: its corners lie on one line, so that it covers nothing: move one of them aside")
    edges = [*pairwise(polygon), (polygon[-1], polygon[0])]
    for (i, a), (k, b) in combinations(enumerate(edges), 2):
        if 1 < k - i < len(edges) - 1 and _cross(*a, *b):
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


def _cross(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Whether the segments a-b and c-d cross properly: each has its ends on two sides of the other."""

    def side(p: Point, q: Point, r: Point) -> float:
        """Which side of p-q r lies on, by its sign."""
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0
