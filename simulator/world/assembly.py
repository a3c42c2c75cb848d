"""Putting a scene together, piece by piece."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import BuildingError
from surveilnav.simulator.world.scene import Floor, Instance, Material, Point3, Room, Scene, Stair, point3

#: The renderer's instance ids are 16 bits wide.
MAX_INSTANCES = 65_535


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles with materials, in whatever frame its owner says.

    Attributes:
        vertices: (V, 3) float32 [m].
        triangles: (F, 3) int32 into vertices.
        uvs: (F, 3, 2) float32 texture coordinates of each corner.
        material: (F,) int32 into ``materials``.
    """

    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    uvs: NDArray[np.float32]
    material: NDArray[np.int32]
    materials: tuple[Material, ...]

    def moved(self, T: NDArray[np.float64]) -> Mesh:
        """The mesh under the affine map ``T`` (4, 4). A map that mirrors turns the triangles over, so that outsides stay
        outside."""
        vertices = (self.vertices.astype(np.float64) @ T[:3, :3].T + T[:3, 3]).astype(np.float32)
        step = -1 if np.linalg.det(T[:3, :3]) < 0 else 1
        triangles, uvs = self.triangles[:, ::step].copy(), self.uvs[:, ::step].copy()
        return Mesh(vertices, triangles, uvs, self.material, self.materials)

    def part(self, chosen: NDArray[np.bool_]) -> Mesh:
        """The ``chosen`` triangles (F,) alone, with the vertices that they use."""
        used, renumbered = np.unique(self.triangles[chosen], return_inverse=True)
        triangles = renumbered.reshape(-1, 3).astype(np.int32)
        return Mesh(self.vertices[used], triangles, self.uvs[chosen], self.material[chosen], self.materials)

    @property
    def box_m(self) -> tuple[Point3, Point3]:
        """Its lowest and highest corner (x, y, z)."""
        return point3(self.vertices.min(axis=0)), point3(self.vertices.max(axis=0))


class MeshBuilder:
    """Collects flat polygons into a mesh."""

    def __init__(self) -> None:
        self._vertices: list[NDArray[np.float64]] = []
        self._triangles: list[NDArray[np.int32]] = []
        self._uvs: list[NDArray[np.float64]] = []
        self._material: list[int] = []
        self._materials: list[Material] = []
        self._count = 0

    def material(self, material: Material) -> int:
        """The index of a material, added if it is new."""
        for index, known in enumerate(self._materials):
            if known is material:
                return index
        self._materials.append(material)
        return len(self._materials) - 1

    def triangles(
        self,
        points: NDArray[np.float64],
        triangles: NDArray[np.int32],
        material: Material,
        uv: NDArray[np.float64] | None = None,
    ) -> None:
        """Adds ``triangles`` (F, 3) over ``points`` (P, 3) [m] with ``uv`` (P, 2) (default: zeros)."""
        if len(triangles) == 0:
            return
        uv = np.zeros((len(points), 2)) if uv is None else uv
        self._vertices.append(points)
        self._triangles.append((triangles + self._count).astype(np.int32))
        self._uvs.append(uv[triangles])
        self._material.extend([self.material(material)] * len(triangles))
        self._count += len(points)

    def quad(
        self, corners: Sequence[Sequence[float]], material: Material, uv: Sequence[Sequence[float]] | None = None
    ) -> None:
        """Adds a convex quadrilateral, corners counter-clockwise seen from outside."""
        uv_array = None if uv is None else np.asarray(uv, dtype=np.float64)
        triangles = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
        self.triangles(np.asarray(corners, dtype=np.float64), triangles, material, uv_array)

    def box(self, low: Sequence[float], high: Sequence[float], material: Material, tile_m: float = 1.0) -> None:
        """Adds an axis-aligned box; its texture repeats every ``tile_m``."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        for corners in (
            [(x0, y0, z0), (x0, y1, z0), (x1, y1, z0), (x1, y0, z0)],
            [(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)],
            [(x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)],
            [(x1, y1, z0), (x0, y1, z0), (x0, y1, z1), (x1, y1, z1)],
            [(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)],
            [(x0, y1, z0), (x0, y0, z0), (x0, y0, z1), (x0, y1, z1)],
        ):
            points = np.asarray(corners, dtype=np.float64)
            along = points - points[0]
            u = np.linalg.norm(along @ np.diag([1, 1, 0]), axis=1) if corners[0][2] != corners[2][2] else along[:, 0]
            v = along[:, 2] if corners[0][2] != corners[2][2] else along[:, 1]
            self.quad(corners, material, (np.stack([u, v], axis=1) / tile_m).tolist())

    def mesh(self) -> Mesh:
        """All that was added."""
        return Mesh(
            np.concatenate([np.zeros((0, 3)), *self._vertices]).astype(np.float32),
            np.concatenate([np.zeros((0, 3), np.int32), *self._triangles]),
            np.concatenate([np.zeros((0, 3, 2)), *self._uvs]).astype(np.float32),
            np.asarray(self._material, dtype=np.int32),
            tuple(self._materials),
        )


@dataclass(slots=True)
class SceneBuilder:
    """Collects pieces, rooms, floors and stairs into a ``Scene``."""

    name: str
    rooms: list[Room] = field(default_factory=list)
    floors: list[Floor] = field(default_factory=list)
    stairs: list[Stair] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    credits: list[str] = field(default_factory=list)
    instances: list[Instance] = field(default_factory=list)
    max_triangles: int = 5_000_000
    _meshes: list[Mesh] = field(default_factory=list)
    _triangles: int = 0

    def floor(self, floor_id: str) -> Floor:
        return next(floor for floor in self.floors if floor.id == floor_id)

    def add(self, mesh: Mesh, name: str, label: str, floor: str, *, model: str = "", room: str = "") -> int:
        """Adds a piece whose mesh is in the world; returns the id of its instance, 0 for an empty mesh."""
        if len(mesh.triangles) == 0:
            return 0
        if len(self.instances) >= MAX_INSTANCES:
            raise BuildingError(f"{self.name} has more than {MAX_INSTANCES} pieces: split it into several buildings")
        self._triangles += len(mesh.triangles)
        if self._triangles > self.max_triangles:
            raise BuildingError(f"{self.name} has more than {self.max_triangles} triangles: use simpler models")
        number = len(self.instances) + 1
        self.instances.append(Instance(number, name, label, floor, *mesh.box_m, model, room))
        self._meshes.append(mesh)
        return number

    def build(self, source: str) -> Scene:
        """The scene, hashed."""
        if not self._meshes:
            raise BuildingError(f"{self.name} is empty: expected at least one wall, room or piece of furniture")
        materials = {id(m): m for mesh in self._meshes for m in mesh.materials}
        index_of = {key: index for index, key in enumerate(materials)}
        offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in self._meshes)])
        tables = [np.array([index_of[id(m)] for m in mesh.materials], dtype=np.int32) for mesh in self._meshes]
        arrays = (
            np.concatenate([mesh.vertices for mesh in self._meshes]),
            np.concatenate(
                [m.triangles + np.int32(first) for m, first in zip(self._meshes, offsets[:-1], strict=True)]
            ),
            np.concatenate([mesh.uvs for mesh in self._meshes]),
            np.concatenate([table[m.material] for table, m in zip(tables, self._meshes, strict=True)]),
            np.repeat(np.arange(1, len(self._meshes) + 1, dtype=np.uint16), [len(m.triangles) for m in self._meshes]),
        )
        return Scene(
            self.name,
            *arrays,
            materials=tuple(materials.values()),
            instances=tuple(self.instances),
            rooms=tuple(self.rooms),
            floors=tuple(sorted(self.floors, key=lambda f: f.z_m)),
            stairs=tuple(self.stairs),
            source=source,
            credits=tuple(dict.fromkeys(self.credits)),
            content_hash=_hash(arrays, materials.values(), self.instances),
            notes=tuple(dict.fromkeys(self.notes)),
        )


def _hash(arrays: Sequence[NDArray], materials: Iterable[Material], instances: Sequence[Instance]) -> str:
    """A digest, in 40 hex digits, of everything that pictures of the scene depend on."""
    digest = hashlib.blake2b(digest_size=20)
    for array in arrays:
        digest.update(np.ascontiguousarray(array).data)
    for m in materials:
        digest.update(repr((m.color, m.alpha, m.shininess)).encode())
        if m.texture is not None:
            digest.update(repr(m.texture.shape).encode())
            digest.update(np.ascontiguousarray(m.texture).data)
    digest.update(repr([(i.id, i.label, i.floor) for i in instances]).encode())
    return digest.hexdigest()
