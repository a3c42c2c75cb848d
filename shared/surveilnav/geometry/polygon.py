"""Polygons in a picture. Corners (x, y) are shares of its width and height, measured from the corner of the first pixel."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float]
Polygon = Sequence[Point]

#: Limits of what people may write into a file: zones of a view, corners of a zone.
MAX_ZONES, MAX_CORNERS = 100, 100
_MIN_AREA = 1e-9
_SHIFT = 8  # fractional bits of the coordinates that OpenCV gets


def polygon_fault(polygon: Polygon) -> str:
    """Why three or more corners don't form a simple polygon; "" if they do."""
    edges = [*pairwise(polygon), (polygon[-1], polygon[0])]
    if abs(sum(a[0] * b[1] - b[0] * a[1] for a, b in edges)) < 2 * _MIN_AREA:  # the shoelace formula
        return "its corners lie on one line, so that it covers nothing: move one of them aside"
    for (i, a), (k, b) in combinations(enumerate(edges), 2):
        if 1 < k - i < len(edges) - 1 and _segments_cross(*a, *b):
            return f"its sides {i + 1} and {k + 1} cross, so that its inside isn't clear: make two polygons of it"
    return ""


def pixels_in(polygons: Sequence[Polygon], width_px: int, height_px: int) -> NDArray[np.bool_]:
    """(height, width): the pixels that a polygon touches, even slightly, and one more all around."""
    # The mask has a rim of one pixel, so that parts that rounding moves outside the picture still grow back into it.
    mask = np.zeros((height_px + 2, width_px + 2), np.uint8)
    for polygon in polygons:  # one by one: of several at once OpenCV leaves out the overlap
        # The centre of pixel 0 lies half a pixel inside the picture, behind the rim.
        corners = np.array(polygon) * (width_px, height_px) + 0.5
        cv2.fillPoly(mask, [np.round(corners * (1 << _SHIFT)).astype(np.int32)], 1, shift=_SHIFT)
    return np.asarray(cv2.dilate(mask, np.ones((3, 3), np.uint8))[1:-1, 1:-1] != 0)


def _segments_cross(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Whether the segments a-b and c-d cross properly: the ends of each lie on different sides of the other."""

    def side(p: Point, q: Point, r: Point) -> float:
        """Its sign says on which side of the line p-q the point r lies."""
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0
