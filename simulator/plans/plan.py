"""From a plan to a building's shell: walls with openings cut out.

Everything here is in the world frame: metres, z up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surveilnav.simulator.world.assembly import Mesh, MeshBuilder
from surveilnav.simulator.world.polygons import Polygon, intersect_convex, signed_area
from surveilnav.simulator.world.scene import Material

#: An opening cuts a wall when they are parallel to within this angle; else it only touches the wall's end.
PARALLEL_TOLERANCE_RAD = math.radians(25.0)

#: A mitre may reach this many thicknesses beyond the wall's end (Sweet Home 3D's own limit).
MITRE_LIMIT = 2.0

Point = tuple[float, float]
Span = tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """A straight wall: a centre line with a thickness, standing on ``z_m``.

    ``height_m`` at its start, ``end_height_m`` at its end (a sloped wall where they differ). ``at_start`` and
    ``at_end`` are indices of the walls joined there, or None.
    """

    start_m: Point
    end_m: Point
    thickness_m: float
    height_m: float
    end_height_m: float
    z_m: float
    left: Material
    right: Material
    at_start: int | None = None
    at_end: int | None = None

    @property
    def length_m(self) -> float:
        """Of the centre line."""
        return math.dist(self.start_m, self.end_m)


@dataclass(frozen=True, slots=True)
class Opening:
    """A door's or window's box: centre, turned by ``yaw_rad``, cut out of the walls that it lies on."""

    centre_m: Point
    yaw_rad: float
    width_m: float
    depth_m: float
    z_low_m: float
    z_high_m: float

    @property
    def outline(self) -> Polygon:
        """Its four corners, counter-clockwise."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        w, d = self.width_m / 2, self.depth_m / 2
        corners = np.array([[-w, -d], [w, -d], [w, d], [-w, d]])
        outline: Polygon = corners @ np.array([[c, s], [-s, c]]) + np.array(self.centre_m)
        return outline


def _straight_outline(wall: Wall) -> Polygon:
    """Corners: left start, left end, right end, right start."""
    a, b = np.array(wall.start_m), np.array(wall.end_m)
    d = (b - a) / max(wall.length_m, 1e-9)
    n = np.array([-d[1], d[0]]) * wall.thickness_m / 2
    return np.array([a + n, b + n, b - n, a - n])


def wall_outline(walls: Sequence[Wall], index: int) -> Polygon:
    """Corners (4, 2): left start, left end, right end, right start, mitred with the joined walls."""
    wall = walls[index]
    plain = _straight_outline(wall)
    outline = plain.copy()
    for at_start in (True, False):
        joined = wall.at_start if at_start else wall.at_end
        if joined is None or not 0 <= joined < len(walls) or joined == index:
            continue
        other = walls[joined]
        theirs = _straight_outline(other)
        here = wall.start_m if at_start else wall.end_m
        meets_their_end = math.dist(here, other.end_m) < math.dist(here, other.start_m)
        # Head to tail the left sides continue each other; head to head, left continues right.
        same_sense = meets_their_end == at_start
        left, right = (theirs[[0, 1]], theirs[[3, 2]]) if same_sense else (theirs[[3, 2]], theirs[[0, 1]])
        limit = MITRE_LIMIT * max(wall.thickness_m, other.thickness_m)
        corner_left, corner_right = (0, 3) if at_start else (1, 2)
        outline[corner_left] = _mitre(plain[corner_left], plain[1] - plain[0], left, limit)
        outline[corner_right] = _mitre(plain[corner_right], plain[2] - plain[3], right, limit)
    return outline


def _mitre(corner: NDArray, direction: NDArray, side: Polygon, limit_m: float) -> NDArray:
    """Where the line through ``corner`` meets the joined wall's side, or the corner itself if that is too far."""
    other = side[1] - side[0]
    cross = direction[0] * other[1] - direction[1] * other[0]
    if abs(cross) <= 1e-3 * np.linalg.norm(direction) * np.linalg.norm(other):
        return corner  # parallel, or a wall without length
    offset = side[0] - corner
    t = (offset[0] * other[1] - offset[1] * other[0]) / cross
    point = corner + t * direction
    return point if np.linalg.norm(point - corner) <= limit_m else corner


def build_wall(wall: Wall, outline: Polygon, openings: Sequence[Opening]) -> tuple[Mesh, list[Polygon]]:
    """The wall's faces with the openings cut through, and the thresholds: the ground (4, 2) left free in each opening whose
    foot lies within 5 cm of the wall's."""
    if wall.length_m < 1e-4:
        return MeshBuilder().mesh(), []
    sides = _Sides(wall, outline)
    holes = _holes(sides, openings)
    mesh = _faces(sides, _columns(sides, holes), wall.left)
    thresholds = [
        np.array([sides.right(hole.s0), sides.right(hole.s1), sides.left(hole.s1), sides.left(hole.s0)])
        for hole in holes
        if abs(hole.z0 - wall.z_m) < 0.05 or hole.z0 < wall.z_m < hole.z0 + 0.5
    ]
    return mesh, thresholds


class _Sides:
    """A wall's two sides by the length ``s`` [m] along it, from ``first`` to ``last``; mitred at both ends."""

    def __init__(self, wall: Wall, outline: Polygon) -> None:
        self.wall, self.outline = wall, outline
        self.start = np.array(wall.start_m)
        self.along = (np.array(wall.end_m) - self.start) / wall.length_m
        s_corner = (outline - self.start) @ self.along
        #: Between these both sides are there.
        self.low, self.high = max(s_corner[0], s_corner[3]) + 1e-3, min(s_corner[1], s_corner[2]) - 1e-3
        self.first, self.last = min(s_corner[0], s_corner[3]), max(s_corner[1], s_corner[2])

    def left(self, s: float) -> NDArray[np.float64]:
        """The point (x, y) of the left side at ``s``."""
        return self._at(s, (0, 1), 1.0)

    def right(self, s: float) -> NDArray[np.float64]:
        """The point (x, y) of the right side at ``s``."""
        return self._at(s, (3, 2), -1.0)

    def _at(self, s: float, ends: tuple[int, int], sign: float) -> NDArray[np.float64]:
        if s in (self.first, self.last):
            return np.asarray(self.outline[ends[0] if s == self.first else ends[1]])
        normal = np.array([-self.along[1], self.along[0]]) * self.wall.thickness_m / 2
        return np.asarray(self.start + self.along * s + sign * normal)

    def top(self, s: float) -> float:
        """The wall's upper edge [m] at ``s``."""
        wall = self.wall
        return wall.z_m + wall.height_m + (wall.end_height_m - wall.height_m) * min(1.0, max(0.0, s / wall.length_m))


class _Hole(NamedTuple):
    """What an opening takes of a wall, along it and in height [m]."""

    s0: float
    s1: float
    z0: float
    z1: float


class _Column(NamedTuple):
    """A part of a wall's length in which the same heights are solid."""

    s0: float
    s1: float
    solids: list[Span]


def _holes(sides: _Sides, openings: Sequence[Opening]) -> list[_Hole]:
    """Where along the wall and how high the openings cut it."""
    holes: list[_Hole] = []
    for opening in openings:
        span = _span_on_wall(sides.wall, sides.outline, sides.start, sides.along, opening)
        if span is None or sides.low >= sides.high:
            continue
        s0 = sides.first if span[0] <= sides.low else span[0]
        s1 = sides.last if span[1] >= sides.high else span[1]
        if s1 - s0 > 1e-3:
            holes.append(_Hole(s0, s1, opening.z_low_m, opening.z_high_m))
    return holes


def _columns(sides: _Sides, holes: Sequence[_Hole]) -> list[_Column]:
    """Columns between all the holes' edges: in each, the solid parts from below to above."""
    cuts = sorted({sides.first, sides.last, *(v for h in holes for v in h[:2])})
    columns: list[_Column] = []
    for s0, s1 in pairwise(cuts):
        if s1 - s0 < 1e-6:
            continue
        middle = (s0 + s1) / 2
        gaps = [(h.z0, h.z1) for h in holes if h.s0 < middle < h.s1]
        columns.append(_Column(s0, s1, _solid(sides.wall.z_m, max(sides.top(s0), sides.top(s1)), gaps)))
    return columns


def _faces(sides: _Sides, columns: Sequence[_Column], reveal: Material) -> Mesh:
    """The faces of all columns: around each, where neighbours differ in height, and at the wall's ends."""
    mesh = MeshBuilder()
    for column in columns:
        for z0, z1 in column.solids:
            _add_solid(mesh, sides, column, z0, z1, reveal)
    for (_, s, before), (_, _, after) in pairwise(columns):
        for z0, z1 in _difference(before, after):
            _add_end(mesh, sides.right(s), sides.left(s), z0, min(z1, sides.top(s)), reveal)
        for z0, z1 in _difference(after, before):
            _add_end(mesh, sides.left(s), sides.right(s), z0, min(z1, sides.top(s)), reveal)
    if columns:
        outline = sides.outline
        for z0, z1 in columns[0].solids:
            _add_end(mesh, outline[0], outline[3], z0, min(z1, sides.top(sides.first)), reveal)
        for z0, z1 in columns[-1].solids:
            _add_end(mesh, outline[2], outline[1], z0, min(z1, sides.top(sides.last)), reveal)
    return mesh.mesh()


def _add_solid(mesh: MeshBuilder, sides: _Sides, column: _Column, z0: float, z1: float, reveal: Material) -> None:
    """Left, right, upper and lower face of a solid part of a column."""
    s0, s1, wall = column.s0, column.s1, sides.wall
    t0, t1 = max(z0, min(z1, sides.top(s0))), max(z0, min(z1, sides.top(s1)))
    la, lb, ra, rb = sides.left(s0), sides.left(s1), sides.right(s0), sides.right(s1)
    mesh.quad([(*lb, z0), (*la, z0), (*la, t0), (*lb, t1)], wall.left, [(-s1, z0), (-s0, z0), (-s0, t0), (-s1, t1)])
    mesh.quad([(*ra, z0), (*rb, z0), (*rb, t1), (*ra, t0)], wall.right, [(s0, z0), (s1, z0), (s1, t1), (s0, t0)])
    mesh.quad([(*ra, t0), (*rb, t1), (*lb, t1), (*la, t0)], reveal)
    mesh.quad([(*la, z0), (*lb, z0), (*rb, z0), (*ra, z0)], reveal)


def _add_end(mesh: MeshBuilder, a: NDArray, b: NDArray, z: float, top: float, reveal: Material) -> None:
    """An upright face from ``a`` to ``b``."""
    mesh.quad([(*a, z), (*b, z), (*b, top), (*a, top)], reveal)


def _span_on_wall(wall: Wall, outline: Polygon, start: NDArray, along: NDArray, opening: Opening) -> Span | None:
    """The part of the wall's length that an opening takes, or None."""
    if opening.z_high_m <= wall.z_m or opening.z_low_m >= wall.z_m + max(wall.height_m, wall.end_height_m):
        return None
    between = (opening.yaw_rad - math.atan2(along[1], along[0])) % math.pi
    if min(between, math.pi - between) > PARALLEL_TOLERANCE_RAD:
        return None
    common = intersect_convex(opening.outline, outline)
    if len(common) < 3 or abs(signed_area(common)) < 1e-5:
        return None
    s = (common - start) @ along
    return float(s.min()), float(s.max())


def _solid(low: float, high: float, gaps: Sequence[Span]) -> list[Span]:
    """What is left of [low, high] without the gaps, from below to above."""
    solids: list[Span] = []
    at = low
    for z0, z1 in sorted(gaps):
        if z0 - at > 1e-3:
            solids.append((at, min(z0, high)))
        at = max(at, z1)
    if high - at > 1e-3:
        solids.append((at, high))
    return solids


def _difference(ours: Sequence[Span], theirs: Sequence[Span]) -> list[Span]:
    """What of our spans lies in none of theirs."""
    return [
        rest
        for z0, z1 in ours
        for rest in _solid(z0, z1, [(max(a, z0), min(b, z1)) for a, b in theirs if a < z1 and b > z0])
    ]
