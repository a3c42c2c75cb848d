"""A building as geometry: triangles with materials, instances with labels, floors with outlines.

Every source (Sweet Home 3D, generator, mesh) ends in a ``Scene``; renderer, navigation and camera
placement start from one.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surveilnav.simulator.world.labels import PARTS, word_for

#: (x, y, z) [m] in the world.
Point3 = tuple[float, float, float]


def point3(p: ArrayLike) -> Point3:
    """The three numbers of an array as plain floats."""
    x, y, z = np.asarray(p).tolist()
    return float(x), float(y), float(z)


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """Diffuse appearance. ``texture`` is (H, W, 3) uint8 sRGB, row 0 at v = 1 (top), multiplied by ``color``; or None.

    ``color`` is sRGB 0-1; ``alpha`` < 1 is glass (rendered as if absent below 0.5).
    """

    name: str
    color: tuple[float, float, float]
    texture: NDArray[np.uint8] | None = None
    alpha: float = 1.0
    shininess: float = 0.0


@dataclass(frozen=True, slots=True)
class Instance:
    """One piece of the building. ``id`` >= 1; 0 is nothing.

    ``label`` is the canonical class ("couch"), or a structural one: "wall", "floor", "ceiling", "door", "window",
    "stairs", or "" for things without a class. ``p_min``, ``p_max``: axis-aligned box in the world [m].
    ``model`` names the furniture model that it was made of.
    """

    id: int
    name: str
    label: str
    floor: str
    p_min: Point3
    p_max: Point3
    model: str = ""
    room: str = ""


@dataclass(frozen=True, slots=True)
class Room:
    """A room's outline: polygon (x, y) [m] in the world."""

    name: str
    floor: str
    polygon_m: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Floor:
    """A floor. ``id`` can stand in a key ("0", "1", "basement"); ``z_m`` is the altitude of its floor surface."""

    id: str
    name: str
    z_m: float
    height_m: float


@dataclass(frozen=True, slots=True)
class Stair:
    """A transit between floors: (x, y, z) [m] where one steps on below and off above, and the way's length.

    ``lower_m``/``upper_m`` lie on free floor just before the first and after the last tread.
    """

    lower_floor: str
    upper_floor: str
    lower_m: Point3
    upper_m: Point3
    length_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A whole building.

    Attributes:
        name: short, unique ("3_bedroom-s0").
        vertices: (V, 3) float32 [m, world].
        triangles: (F, 3) int32 into vertices.
        uvs: (F, 3, 2) float32 texture coordinates of each corner (wrap around).
        material_of_triangle: (F,) int32 into ``materials``.
        instance_of_triangle: (F,) uint16, the id of the instance (0: none).
        materials, instances, rooms, floors, stairs: see their classes; floors from lowest to highest.
        source: where it came from, for people; ``credits``: names and licences of what is in it.
        content_hash: hex digest of everything above that a picture depends on: the key of every cache.
    """

    name: str
    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    uvs: NDArray[np.float32]
    material_of_triangle: NDArray[np.int32]
    instance_of_triangle: NDArray[np.uint16]
    materials: tuple[Material, ...]
    instances: tuple[Instance, ...]
    rooms: tuple[Room, ...]
    floors: tuple[Floor, ...]
    stairs: tuple[Stair, ...] = ()
    source: str = ""
    credits: tuple[str, ...] = ()
    content_hash: str = ""
    notes: tuple[str, ...] = field(default=())

    def floor(self, floor_id: str) -> Floor:
        """The floor of that id; KeyError lists the valid ones."""
        for floor in self.floors:
            if floor.id == floor_id:
                return floor
        raise KeyError(f"no floor {floor_id!r} in {self.name}; it has {[f.id for f in self.floors]}")

    def floor_at(self, z_m: float) -> Floor:
        """The highest floor whose surface lies at or (within 0.5 m) just above ``z_m``."""
        below = [f for f in self.floors if f.z_m <= z_m + 0.5]
        return below[-1] if below else self.floors[0]

    def labelled(self, label: str) -> tuple[Instance, ...]:
        return tuple(i for i in self.instances if i.label == label)

    @property
    def labels_by_id(self) -> dict[int, str]:
        """Class name by instance id, for those that have one of their own (no walls and floors)."""
        return {i.id: i.label for i in self.instances if i.label and i.label not in PARTS}

    @property
    def truth_labels(self) -> dict[int, str]:
        """The same with the parts of the building, and with a word for what has no class: its kind of furniture, else its
        name. It is what the perception backends that are told the truth are told."""
        told = ((i.id, word_for(i.name, i.label)) for i in self.instances)
        return {id_: word for id_, word in told if word}

    def called(self, word: str) -> tuple[Instance, ...]:
        """All instances that ``truth_labels`` call so."""
        words = self.truth_labels
        return tuple(i for i in self.instances if words.get(i.id) == word)
