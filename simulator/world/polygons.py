"""Polygons in the plane: triangles of concave ones, and what is left when others are cut out.

A polygon is an (N, 2) array, not closed (the last point isn't the first again).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Polygon = NDArray[np.float64]

#: Twice the area below which a triangle is nothing [m²].
_TINY = 1e-12


def signed_area(polygon: Polygon) -> float:
    """The area, positive where the corners go counter-clockwise (shoelace formula)."""
    x, y = polygon[:, 0], polygon[:, 1]
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def ear_clip(polygon: Polygon) -> NDArray[np.int32]:
    """Triangles (F, 3) that fill a simple polygon, concave ones included, wound like the polygon.

    Ear clipping (Meisters 1975), O(n²) for the polygons met here. Degenerate input gives what can be filled.
    """
    points = np.asarray(polygon, dtype=np.float64)
    n = len(points)
    if n < 3:
        return np.zeros((0, 3), np.int32)
    clockwise = signed_area(points) < 0
    ring = list(range(n - 1, -1, -1)) if clockwise else list(range(n))
    xy = [(float(x), float(y)) for x, y in points]
    triangles: list[tuple[int, int, int]] = []
    while len(ring) > 3:
        best = -1
        for i in range(len(ring)):
            a, b, c = xy[ring[i - 1]], xy[ring[i]], xy[ring[(i + 1) % len(ring)]]
            turn = (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
            if turn <= _TINY:
                # A spike or a point on a straight edge carries no area: drop it without a triangle.
                if abs(turn) <= _TINY:
                    best = i
                    break
                continue
            if not any(_inside(xy[k], a, b, c) for k in ring if xy[k] not in (a, b, c)):
                best = i
                break
        if best < 0:  # self-intersecting: clip the most convex corner rather than loop for ever
            best = max(range(len(ring)), key=lambda i: _turn(xy, ring, i))
        if _turn(xy, ring, best) > _TINY:
            triangles.append((ring[best - 1], ring[best], ring[(best + 1) % len(ring)]))
        ring.pop(best)
    if _turn(xy, ring, 1) > _TINY:
        triangles.append((ring[0], ring[1], ring[2]))
    result = np.array(triangles, dtype=np.int32).reshape(-1, 3)
    return result[:, ::-1].copy() if clockwise else result


def _turn(xy: list[tuple[float, float]], ring: list[int], i: int) -> float:
    a, b, c = xy[ring[i - 1]], xy[ring[i]], xy[ring[(i + 1) % len(ring)]]
    return (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])


def _inside(p: tuple[float, float], a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Whether ``p`` lies in or on the counter-clockwise triangle a, b, c."""
    return (
        (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) >= 0
        and (c[0] - b[0]) * (p[1] - b[1]) - (c[1] - b[1]) * (p[0] - b[0]) >= 0
        and (a[0] - c[0]) * (p[1] - c[1]) - (a[1] - c[1]) * (p[0] - c[0]) >= 0
    )


def clip_half_plane(
    polygon: Polygon, a: NDArray[np.float64], b: NDArray[np.float64], keep_left: bool = True
) -> Polygon:
    """The part of a convex polygon on one side of the line from ``a`` to ``b`` (Sutherland and Hodgman 1974)."""
    sign = 1.0 if keep_left else -1.0
    d = sign * ((b[0] - a[0]) * (polygon[:, 1] - a[1]) - (b[1] - a[1]) * (polygon[:, 0] - a[0]))
    kept: list[NDArray[np.float64]] = []
    for i in range(len(polygon)):
        j = (i + 1) % len(polygon)
        if d[i] >= 0:
            kept.append(polygon[i])
        if (d[i] > 0 > d[j]) or (d[i] < 0 < d[j]):
            kept.append(polygon[i] + (polygon[j] - polygon[i]) * (d[i] / (d[i] - d[j])))
    return np.array(kept).reshape(-1, 2)


def intersect_convex(polygon: Polygon, convex: Polygon) -> Polygon:
    """The common part of two convex polygons; (0, 2) where there is none."""
    ring = convex if signed_area(convex) > 0 else convex[::-1]
    for i in range(len(ring)):
        if len(polygon) < 3:
            return np.zeros((0, 2))
        polygon = clip_half_plane(polygon, ring[i], ring[(i + 1) % len(ring)])
    return polygon if len(polygon) >= 3 else np.zeros((0, 2))


def subtract(polygon: Polygon, holes: Iterable[Polygon]) -> list[Polygon]:
    """Convex pieces, counter-clockwise, that fill ``polygon`` outside of all ``holes`` (any simple polygons)."""
    pieces = _convex_parts(polygon)
    for hole in holes:
        for cut in _convex_parts(hole):
            pieces = [rest for piece in pieces for rest in _subtract_convex(piece, cut)]
    return pieces


def _convex_parts(polygon: Polygon) -> list[Polygon]:
    points = polygon if signed_area(polygon) > 0 else polygon[::-1]
    edges = np.roll(points, -1, axis=0) - points
    following = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    if len(points) == 4 and np.all(turns >= 0):
        return [points]
    return [points[t] for t in ear_clip(points)]


def _subtract_convex(piece: Polygon, cut: Polygon) -> list[Polygon]:
    if np.any(piece.max(axis=0) <= cut.min(axis=0)) or np.any(piece.min(axis=0) >= cut.max(axis=0)):
        return [piece]
    rest: list[Polygon] = []
    for i in range(len(cut)):
        a, b = cut[i], cut[(i + 1) % len(cut)]
        outside = clip_half_plane(piece, a, b, keep_left=False)
        if len(outside) >= 3 and abs(signed_area(outside)) > 1e-9:
            rest.append(outside)
        piece = clip_half_plane(piece, a, b)
        if len(piece) < 3 or abs(signed_area(piece)) < 1e-9:
            break
    return rest


def contains(polygon: Polygon, point: NDArray[np.float64]) -> bool:
    """Whether a point lies in a simple polygon (even-odd rule)."""
    x, y = float(point[0]), float(point[1])
    x0, y0 = polygon[:, 0], polygon[:, 1]
    x1, y1 = np.roll(x0, -1), np.roll(y0, -1)
    crosses = (y0 > y) != (y1 > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = x0 + (y - y0) / (y1 - y0) * (x1 - x0)
    return bool(np.count_nonzero(crosses & (x < at)) % 2)
