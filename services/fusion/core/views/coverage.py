"""How much of a room is in view of cameras: so that an answer "not seen" can say where nobody looks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry.polygon import Polygon
from surveilnav.services.fusion.core.maps.projection import AZIMUTHS
from surveilnav.services.fusion.core.views.order import KnownFloor, ViewFootprint, visible_ranges_m

#: Distance of the points of a room that are tested [m]; larger in a large room, so that there are at most this many.
_SPACING_M, _MAX_POINTS = 0.1, 20_000
#: A camera that sees less than this of a room sees a strip through its door, and not the room.
_MIN_SHARE = 0.02
#: Corners lie within this distance from the origin [m].
_MAX_COORDINATE_M = 10_000.0


def is_outline(corners_m: Polygon) -> bool:
    """Whether corners (x, y) [m, world] can be those of a room."""
    within = all(abs(x) <= _MAX_COORDINATE_M and abs(y) <= _MAX_COORDINATE_M for x, y in corners_m)  # NaN isn't
    return within and len(corners_m) >= 3


def room_points_m(outline_m: Polygon) -> NDArray[np.float64]:
    """Points (N, 2) [m, world] on a lattice inside a polygon."""
    corners = np.asarray(outline_m, np.float64)
    low, extent_m = corners.min(axis=0), np.ptp(corners, axis=0)
    spacing_m = max(_SPACING_M, math.sqrt(float(extent_m.prod()) / _MAX_POINTS))
    x, y = (np.arange(spacing_m / 2, extent, spacing_m) for extent in extent_m)
    points = low + np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    inside = np.zeros(len(points), np.bool_)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        # inside is what a ray towards +x leaves through an odd number of sides
        crosses = (ay > points[:, 1]) != (by > points[:, 1])
        inside ^= crosses & (points[:, 0] < ax + (points[:, 1] - ay) * (bx - ax) / ((by - ay) or 1.0))
    return np.asarray(points[inside])


def room_shares(
    outline_m: Polygon, views: Mapping[str, Sequence[ViewFootprint]], floor: KnownFloor | None
) -> tuple[float, dict[str, float]]:
    """The share of a room's floor that cameras see.

    A point is in view if it lies in the footprint of a view, no known obstacle stands before it, and it was explored. As long as
    nothing of the floor is explored, as with cameras that have no depth at all, the last doesn't count. Points under obstacles
    belong to furniture and count neither as seen nor as unseen.

    Args:
        outline_m: corners of the room [m, world].
        views: the views of each camera on the room's floor.
        floor: what is known of the floor; None: nothing.

    Returns:
        (the share, 0-1; the share that each camera sees, without those that see less than 2 %).
    """
    points_m = room_points_m(outline_m)
    believed = np.ones(len(points_m), np.bool_)
    if floor is not None:
        cells = floor.grid.cells_of(points_m)
        inside = floor.grid.contains(cells)
        row, col = np.where(inside[:, None], cells, 0).T
        standing = inside & (floor.occupied[row, col] > 0)
        if floor.explored.any():
            believed = inside & (floor.explored[row, col] > 0)
        points_m, believed = points_m[~standing], believed[~standing]
    if not len(points_m):
        return 0.0, {}
    seen_by = {
        camera: believed & np.any([_sees(view, floor, points_m) for view in own], axis=0)
        for camera, own in views.items()
        if own
    }
    seen_by = {camera: seen for camera, seen in seen_by.items() if seen.mean() >= _MIN_SHARE}
    shares = {camera: float(seen.mean()) for camera, seen in seen_by.items()}
    return float(np.any([*seen_by.values()], axis=0).mean()) if seen_by else 0.0, shares


def _sees(view: ViewFootprint, floor: KnownFloor | None, points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether a view sees each of the points (N, 2), up to the first known obstacle."""
    ranges_m = visible_ranges_m(view, floor)
    away = points_m - (view.x_m, view.y_m)
    azimuth = np.arctan2(away[:, 1], away[:, 0]) / (2 * math.pi)
    nearest_m, farthest_m = ranges_m[(azimuth * AZIMUTHS).astype(int) % AZIMUTHS].T
    distance_m = np.linalg.norm(away, axis=1)
    return np.asarray((nearest_m <= distance_m) & (distance_m < farthest_m))
