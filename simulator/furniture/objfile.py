"""Wavefront OBJ and MTL, as people really write them.

Tolerated: odd case, spaces in names, missing textures, negative indices, polygons that are concave, faces
without normals or texture coordinates. Refused with a ``BuildingError``: files without a triangle, numbers that
are not finite, and files larger than the limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.plans.polygons import ear_clip
from surveilnav.errors import BuildingError

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
        data: the file's bytes.
        name: for messages.

    Raises:
        BuildingError: nothing to draw, numbers that are not finite, or more than the limits.
    """
    positions: list[str] = []
    textures: list[tuple[str, str]] = []
    corners: list[tuple[int, int]] = []
    faces: list[int] = []  # corners per face
    face_material: list[int] = []
    face_group: list[int] = []
    materials: dict[str, int] = {"": 0}
    groups: dict[str, int] = {"": 0}
    material = group = 0
    libraries: list[str] = []
    text = data.decode("utf-8", errors="replace").replace("\\\r\n", " ").replace("\\\n", " ")
    for line in text.splitlines():
        head, rest = _split(line)
        if head == "v":
            words = rest.split()
            if len(words) < 3:
                raise BuildingError(f"{name}: a vertex has three coordinates, got {line[:60]!r}")
            positions.extend(words[:3])
            if len(positions) > 3 * MAX_VERTICES:
                raise BuildingError(f"{name} has more than {MAX_VERTICES} vertices: use a simpler model")
        elif head == "f":
            words = rest.split()
            if len(words) > MAX_CORNERS_PER_FACE:
                raise BuildingError(f"{name}: a face has at most {MAX_CORNERS_PER_FACE} corners, got {len(words)}")
            count_v, count_t, before = len(positions) // 3, len(textures), len(corners)
            try:
                for word in words:
                    parts = word.split("/")
                    v = int(parts[0])
                    t = int(parts[1]) if len(parts) > 1 and parts[1] else 0
                    corners.append((v - 1 if v > 0 else count_v + v, t - 1 if t > 0 else count_t + t if t else -1))
            except ValueError as error:
                raise BuildingError(f"{name}: a face has indices like 1/2/3, got {line[:60]!r}") from error
            if len(words) < 3:
                del corners[before:]
                continue
            faces.append(len(words))
            face_material.append(material)
            face_group.append(group)
            if len(corners) > 3 * MAX_TRIANGLES:
                raise BuildingError(f"{name} has more than {MAX_TRIANGLES} triangles: use a simpler model")
        elif head == "vt":
            words = rest.split()
            textures.append((words[0] if words else "0", words[1] if len(words) > 1 else "0"))
        elif head == "usemtl":
            material = materials.setdefault(rest, len(materials))
        elif head in ("g", "o"):
            group = groups.setdefault(rest, len(groups))
        elif head == "mtllib":
            libraries.append(rest)
    return _assemble(
        name, positions, textures, corners, faces, face_material, face_group, tuple(materials), tuple(groups),
        tuple(libraries),
    )  # fmt: skip


def _assemble(
    name: str, positions: list[str], textures: list[tuple[str, str]], corners: list[tuple[int, int]], faces: list[int],
    face_material: list[int], face_group: list[int], materials: tuple[str, ...], groups: tuple[str, ...],
    libraries: tuple[str, ...],
) -> ObjModel:  # fmt: skip
    try:
        xyz = np.array(positions, dtype=np.float64).reshape(-1, 3)
        uv = np.array(textures, dtype=np.float64).reshape(-1, 2)
    except ValueError as error:
        raise BuildingError(f"{name}: coordinates must be numbers ({error})") from error
    if not (np.isfinite(xyz).all() and np.abs(xyz).max(initial=0.0) < 1e9):
        raise BuildingError(f"{name}: coordinates must be finite and below 1e9")
    uv = np.nan_to_num(uv, nan=0.0, posinf=0.0, neginf=0.0)
    index = np.array(corners, dtype=np.int64).reshape(-1, 2)
    if len(index) and (index[:, 0].min() < 0 or index[:, 0].max() >= len(xyz)):
        raise BuildingError(f"{name}: a face names a vertex that isn't there; it has {len(xyz)}")
    index[(index[:, 1] >= len(uv)) | (index[:, 1] < -1), 1] = -1

    counts = np.array(faces, dtype=np.int64)
    starts = np.concatenate([[0], np.cumsum(counts)])[:-1]
    parts: list[NDArray[np.int64]] = []  # (n, 4): three corners, face
    plain = np.flatnonzero(counts == 3)
    parts.append(np.column_stack([starts[plain], starts[plain] + 1, starts[plain] + 2, plain]))
    quads = np.flatnonzero(counts == 4)
    if len(quads):
        p = xyz[index[starts[quads][:, None] + np.arange(4), 0]]
        convex = _convex_quads(p)
        flat = quads[convex]
        s = starts[flat]
        parts.append(np.column_stack([s, s + 1, s + 2, flat]))
        parts.append(np.column_stack([s, s + 2, s + 3, flat]))
        quads = quads[~convex]
    budget = EAR_CLIP_BUDGET
    for face in [*quads.tolist(), *np.flatnonzero(counts > 4).tolist()]:
        ring = starts[face] + np.arange(counts[face])
        budget -= len(ring) ** 2
        cut = ring[ear_clip(_flattened(xyz[index[ring, 0]])) if budget > 0 else _fan(len(ring))]
        parts.append(np.column_stack([cut, np.full(len(cut), face)]))
    table = np.concatenate(parts) if parts else np.zeros((0, 4), np.int64)
    table = table[np.argsort(table[:, 3], kind="stable")]
    if len(table) == 0:
        raise EmptyModelError(f"{name} has no faces: nothing to draw")
    if len(table) > MAX_TRIANGLES:
        raise BuildingError(f"{name} has more than {MAX_TRIANGLES} triangles: use a simpler model")
    corner = index[table[:, :3]]
    used, renumbered = np.unique(corner[..., 0], return_inverse=True)
    uvs = np.zeros((len(table), 3, 2), np.float32)
    if len(uv):
        has = corner[..., 1] >= 0
        uvs[has] = uv[corner[..., 1][has]]
    return ObjModel(
        xyz[used].astype(np.float32), renumbered.reshape(-1, 3).astype(np.int32), uvs,
        np.array(face_material, np.int32)[table[:, 3]], np.array(face_group, np.int32)[table[:, 3]],
        materials, groups, libraries,
    )  # fmt: skip


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
    found: dict[str, MtlMaterial] = {}
    name = ""
    fields: dict[str, object] = {}

    def finish() -> None:
        if name:
            found[name] = MtlMaterial(**fields)  # type: ignore[arg-type]

    for line in data.decode("utf-8", errors="replace").splitlines():
        head, rest = _split(line)
        head = head.lower()
        if head == "newmtl":
            finish()
            name, fields = rest, {}
        elif head == "kd":
            numbers = _numbers(rest, 3)
            if numbers:
                r, g, b = (min(1.0, max(0.0, v)) for v in numbers)
                fields["color"] = (r, g, b)
        elif head == "d" and (numbers := _numbers(rest.removeprefix("-halo"), 1)):
            fields["alpha"] = min(1.0, max(0.0, numbers[0]))
        elif head == "ns" and (numbers := _numbers(rest, 1)):
            fields["shininess"] = min(128.0, max(0.0, numbers[0]))
        elif head == "map_kd" and rest:
            fields["texture"] = rest
    finish()
    return found


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
