"""Wavefront OBJ and MTL, as people really write them.

Tolerated: odd case, spaces in names, missing textures, negative indices, polygons that are concave, faces
without normals or texture coordinates. Refused with a ``BuildingError``: files without a triangle, numbers that
are not finite, and files larger than the limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import BuildingError
from surveilnav.simulator.world.polygons import ear_clip

MAX_VERTICES = 2_000_000
MAX_TRIANGLES = 2_000_000
MAX_CORNERS_PER_FACE = 512
#: Ear clipping takes time by the square of a polygon's corners: beyond this sum of squares a fan must do.
EAR_CLIP_BUDGET = 4_000_000


class EmptyModelError(BuildingError):
    """A model without a single triangle, as Sweet Home 3D's bare light sources are."""


@dataclass(frozen=True, slots=True, eq=False)
class ObjModel:
    """Geometry of an OBJ file, in its own frame and unit.

    Attributes:
        vertices: (V, 3) float32, only those that a triangle uses.
        triangles: (F, 3) int32; uvs: (F, 3, 2) float32, zeros where the file has none.
        material: (F,) int32 into ``material_names``; group: (F,) int32 into ``group_names``.
        libraries: names of the MTL files that it asks for.
    """

    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    uvs: NDArray[np.float32]
    material: NDArray[np.int32]
    group: NDArray[np.int32]
    material_names: tuple[str, ...]
    group_names: tuple[str, ...]
    libraries: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class MtlMaterial:
    """One ``newmtl``: diffuse colour (None: none given), opacity, shininess 0-128, picture's name or ""."""

    color: tuple[float, float, float] | None = None
    alpha: float = 1.0
    shininess: float = 0.0
    texture: str = ""


def read_obj(data: bytes, name: str = "model") -> ObjModel:
    """Parses an OBJ file.

    Args:
        name: for messages.

    Raises:
        BuildingError: nothing to draw, numbers that are not finite, or more than the limits.
    """
    lines = _Lines(name)
    text = data.decode("utf-8", errors="replace").replace("\\\r\n", " ").replace("\\\n", " ")
    for line in text.splitlines():
        lines.read_line(line)
    xyz, uv = _coordinates(lines)
    index = _indices(lines, len(xyz), len(uv))
    table = _triangles(name, xyz, index, np.array(lines.faces, dtype=np.int64))
    corner, face = index[table[:, :3]], table[:, 3]
    used, renumbered = np.unique(corner[..., 0], return_inverse=True)
    uvs = np.zeros((len(table), 3, 2), np.float32)
    if len(uv):
        has = corner[..., 1] >= 0
        uvs[has] = uv[corner[..., 1][has]]
    return ObjModel(
        xyz[used].astype(np.float32),
        renumbered.reshape(-1, 3).astype(np.int32),
        uvs,
        np.array(lines.face_material, np.int32)[face],
        np.array(lines.face_group, np.int32)[face],
        tuple(lines.materials),
        tuple(lines.groups),
        tuple(lines.libraries),
    )


class _Lines:
    """What the lines of a file said, in its own words and order; corners as (vertex, texture or -1) from 0."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.positions: list[str] = []
        self.textures: list[tuple[str, str]] = []
        self.corners: list[tuple[int, int]] = []
        self.faces: list[int] = []  # corners per face
        self.face_material: list[int] = []
        self.face_group: list[int] = []
        self.materials: dict[str, int] = {"": 0}
        self.groups: dict[str, int] = {"": 0}
        self.libraries: list[str] = []
        self._material = self._group = 0

    def read_line(self, line: str) -> None:
        head, rest = _split(line)
        if head == "v":
            self._vertex(rest, line)
        elif head == "f":
            self._face(rest, line)
        elif head == "vt":
            words = rest.split()
            self.textures.append((words[0] if words else "0", words[1] if len(words) > 1 else "0"))
        elif head == "usemtl":
            self._material = self.materials.setdefault(rest, len(self.materials))
        elif head in ("g", "o"):
            self._group = self.groups.setdefault(rest, len(self.groups))
        elif head == "mtllib":
            self.libraries.append(rest)

    def _vertex(self, rest: str, line: str) -> None:
        words = rest.split()
        if len(words) < 3:
            raise BuildingError(f"{self.name}: a vertex has three coordinates, got {line[:60]!r}")
        self.positions.extend(words[:3])
        if len(self.positions) > 3 * MAX_VERTICES:
            raise BuildingError(f"{self.name} has more than {MAX_VERTICES} vertices: use a simpler model")

    def _face(self, rest: str, line: str) -> None:
        words = rest.split()
        if len(words) > MAX_CORNERS_PER_FACE:
            raise BuildingError(f"{self.name}: a face has at most {MAX_CORNERS_PER_FACE} corners, got {len(words)}")
        count_v, count_t = len(self.positions) // 3, len(self.textures)
        try:
            corners = [_corner(word, count_v, count_t) for word in words]
        except ValueError as error:
            raise BuildingError(f"{self.name}: a face has indices like 1/2/3, got {line[:60]!r}") from error
        if len(words) < 3:
            return
        self.corners += corners
        self.faces.append(len(words))
        self.face_material.append(self._material)
        self.face_group.append(self._group)
        if len(self.corners) > 3 * MAX_TRIANGLES:
            raise BuildingError(f"{self.name} has more than {MAX_TRIANGLES} triangles: use a simpler model")


def _corner(word: str, count_v: int, count_t: int) -> tuple[int, int]:
    """Vertex and texture (-1: none) of a word like "1/2/3"; negative ones count back from the newest."""
    parts = word.split("/")
    v = int(parts[0])
    t = int(parts[1]) if len(parts) > 1 and parts[1] else 0
    return v - 1 if v > 0 else count_v + v, t - 1 if t > 0 else count_t + t if t else -1


def _coordinates(lines: _Lines) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions (V, 3) and texture coordinates (T, 2)."""
    try:
        xyz = np.array(lines.positions, dtype=np.float64).reshape(-1, 3)
        uv = np.array(lines.textures, dtype=np.float64).reshape(-1, 2)
    except ValueError as error:
        raise BuildingError(f"{lines.name}: coordinates must be numbers ({error})") from error
    if not (np.isfinite(xyz).all() and np.abs(xyz).max(initial=0.0) < 1e9):
        raise BuildingError(f"{lines.name}: coordinates must be finite and below 1e9")
    return xyz, np.nan_to_num(uv, nan=0.0, posinf=0.0, neginf=0.0)


def _indices(lines: _Lines, count_v: int, count_t: int) -> NDArray[np.int64]:
    """Vertex and texture (corners, 2) of every corner; -1 for textures that aren't there."""
    try:
        index = np.array(lines.corners, dtype=np.int64).reshape(-1, 2)
    except OverflowError:
        raise BuildingError(f"{lines.name}: a face names a vertex that isn't there; it has {count_v}") from None
    if len(index) and (index[:, 0].min() < 0 or index[:, 0].max() >= count_v):
        raise BuildingError(f"{lines.name}: a face names a vertex that isn't there; it has {count_v}")
    index[(index[:, 1] >= count_t) | (index[:, 1] < -1), 1] = -1
    return index


def _triangles(
    name: str, xyz: NDArray[np.float64], index: NDArray[np.int64], counts: NDArray[np.int64]
) -> NDArray[np.int64]:
    """(F, 4): three corners and the face that they belong to, in the order of faces with ``counts`` corners each."""
    starts = np.concatenate([[0], np.cumsum(counts)])[:-1]
    plain = np.flatnonzero(counts == 3)
    parts = [np.column_stack([starts[plain], starts[plain] + 1, starts[plain] + 2, plain])]
    quads = np.flatnonzero(counts == 4)
    if len(quads):
        convex = _convex_quads(xyz[index[starts[quads][:, None] + np.arange(4), 0]])
        flat, s = quads[convex], starts[quads[convex]]
        parts += [np.column_stack([s, s + 1, s + 2, flat]), np.column_stack([s, s + 2, s + 3, flat])]
        quads = quads[~convex]
    budget = EAR_CLIP_BUDGET
    for face in [*quads.tolist(), *np.flatnonzero(counts > 4).tolist()]:
        ring = starts[face] + np.arange(counts[face])
        budget -= len(ring) ** 2
        cut = ring[ear_clip(_flattened(xyz[index[ring, 0]])) if budget > 0 else _fan(len(ring))]
        parts.append(np.column_stack([cut, np.full(len(cut), face)]))
    table = np.concatenate(parts)
    if len(table) == 0:
        raise EmptyModelError(f"{name} has no faces: nothing to draw")
    if len(table) > MAX_TRIANGLES:
        raise BuildingError(f"{name} has more than {MAX_TRIANGLES} triangles: use a simpler model")
    return table[np.argsort(table[:, 3], kind="stable")]


def _fan(count: int) -> NDArray[np.int32]:
    return np.array([[0, i, i + 1] for i in range(1, count - 1)], dtype=np.int32)


def _convex_quads(p: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of the quadrilaterals (N, 4, 3) may be cut along the first diagonal."""
    edges = np.roll(p, -1, axis=1) - p
    turns = np.cross(np.roll(edges, 1, axis=1), edges)
    normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    inward = np.einsum("nki,ni->nk", turns, normal) < -1e-9 * np.einsum("ni,ni->n", normal, normal)[:, None]
    return np.asarray(~inward.any(axis=1))


def _flattened(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """The polygon (N, 3) in the coordinates (N, 2) of its own plane (normal by Newell's method), about unit size."""
    following = np.roll(p, -1, axis=0)
    n = np.array(
        [
            np.sum((p[:, 1] - following[:, 1]) * (p[:, 2] + following[:, 2])),
            np.sum((p[:, 2] - following[:, 2]) * (p[:, 0] + following[:, 0])),
            np.sum((p[:, 0] - following[:, 0]) * (p[:, 1] + following[:, 1])),
        ]
    )
    axis = int(np.argmax(np.abs(n)))
    keep = [(1, 2), (2, 0), (0, 1)][axis]
    flat = p[:, keep]
    size = float(np.ptp(flat, axis=0).max()) or 1.0
    return np.asarray((flat - flat.min(axis=0)) / size)


def read_mtl(data: bytes) -> dict[str, MtlMaterial]:
    """Parses an MTL file; what can't be understood is left out."""
    fields: dict[str, dict[str, Any]] = {}
    name = ""
    for line in data.decode("utf-8", errors="replace").splitlines():
        head, rest = _split(line)
        if head.lower() == "newmtl":
            name, fields[rest] = rest, {}
        elif name:
            fields[name] |= _mtl_field(head.lower(), rest)
    return {name: MtlMaterial(**facts) for name, facts in fields.items() if name}


def _mtl_field(head: str, rest: str) -> dict[str, Any]:
    """What a line says of its material, as fields of ``MtlMaterial``."""
    if head == "kd" and (numbers := _numbers(rest, 3)):
        r, g, b = (min(1.0, max(0.0, v)) for v in numbers)
        return {"color": (r, g, b)}
    if head == "d" and (numbers := _numbers(rest.removeprefix("-halo"), 1)):
        return {"alpha": min(1.0, max(0.0, numbers[0]))}
    if head == "ns" and (numbers := _numbers(rest, 1)):
        return {"shininess": min(128.0, max(0.0, numbers[0]))}
    return {"texture": rest} if head == "map_kd" and rest else {}


def _split(line: str) -> tuple[str, str]:
    """The first word of a line and the rest of it."""
    words = line.split(None, 1)
    return (words[0], words[1].strip()) if len(words) == 2 else (line.strip(), "")


def _numbers(text: str, count: int) -> list[float] | None:
    try:
        values = [float(word) for word in text.split()[:count]]
    except ValueError:
        return None
    return values if len(values) == count and all(math.isfinite(v) for v in values) else None
