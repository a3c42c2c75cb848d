"""A mesh's parts that stand together are one thing: "Bed_frame", "Bed_mattress" and "Bed_pillow" are a bed.

Names say which parts may belong together, geometry says whether they do. A *body* is a part that covers as much ground as
the whole thing does. Bodies that lie over each other are joined, and the small parts go to the body that they touch. Two
bodies of one size in different places are two things, whatever they are called: twin beds, stacked chairs.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources
from itertools import takewhile
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surveilnav.simulator.meshes.names import label_of_node, whole_of_node
from surveilnav.simulator.world.assembly import Mesh
from surveilnav.simulator.world.labels import plain_name
from surveilnav.simulator.world.scene import point3

#: Large enough for every rule about sizes, where a size isn't known yet.
ANY_SIZE_M = (1.0, 1.0, 1.0)
#: Boxes nearer than this touch.
TOUCH_M = 0.05
#: Bodies are joined where one covers this share of the other's ground.
MIN_SHARED_GROUND = 0.5
#: Bodies whose sides differ by less, in a share of the larger, are of one size.
SAME_SIZE = 0.05
#: Of one class; more are left as they are.
MAX_PARTS = 2_000
#: From a body to the last part that hangs on it: a pillow may lie on a pillow that lies on the bed.
MAX_STEPS = 3

#: Low and high corners (N, 2, 3) [m].
Boxes = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class MeshPart:
    """A thing in the world. ``label`` None: the name decides."""

    name: str
    label: str | None
    meshes: tuple[Mesh, ...]
    room: str = ""
    model: str = ""


@dataclass(frozen=True, slots=True)
class Sizes:
    """A class's sizes [m], see ``data/thing_sizes.json``."""

    body: tuple[float, float]
    max_size: tuple[float, float]


class _PartGroup(NamedTuple):
    """Parts that were found to be one thing: their numbers, the numbers of its bodies, and its box (2, 3) [m]."""

    members: list[int]
    bodies: list[int]
    box: NDArray[np.float64]


@lru_cache(maxsize=1)
def thing_sizes() -> dict[str, Sizes]:
    """Sizes by class."""
    text = resources.files("surveilnav.simulator.furniture").joinpath("data/thing_sizes.json").read_text("utf-8")
    return {
        label: Sizes((row["body"][0], row["body"][1]), (row["max"][0], row["max"][1]))
        for label, row in json.loads(text).items()
        if label != "about"
    }


def whole_things(pieces: Sequence[MeshPart]) -> list[MeshPart]:
    """Puts together the pieces that are parts of one thing; returns the pieces that result.

    A piece whose class the file states itself (``label``) stays as it is.
    """
    kinds: dict[str, list[int]] = {}
    for number, piece in enumerate(pieces):
        solid = bool(piece.meshes) and all(len(mesh.vertices) for mesh in piece.meshes)
        kind = whole_of_node(piece.name, ANY_SIZE_M) if solid and piece.label is None else ""
        if kind in thing_sizes():
            kinds.setdefault(kind, []).append(number)
    changed: dict[int, MeshPart | None] = {}
    for kind, numbers in kinds.items():
        if not 1 < len(numbers) <= MAX_PARTS:
            continue
        boxes = np.array([box_of(pieces[number].meshes) for number in numbers])
        names = [plain_name(pieces[number].name) for number in numbers]
        for group in groups_of(boxes, names, thing_sizes()[kind]):
            whole = _merged([pieces[numbers[member]] for member in group], kind)
            if whole is not None:
                changed.update((numbers[member], None) for member in group)
                changed[numbers[min(group)]] = whole
    kept = (changed.get(number, piece) for number, piece in enumerate(pieces))
    return [piece for piece in kept if piece is not None]


def groups_of(boxes: Boxes, names: Sequence[str], sizes: Sizes) -> list[list[int]]:
    """Finds which parts of one class are one thing. Returns groups of at least two part numbers, the largest body first.

    Args:
        boxes: (N, 2, 3) low and high corners [m], z up.
        names: of the parts, without numbering; bodies of one name that lie above each other are two things.
        sizes: of things of the class.
    """
    ground = np.sort(boxes[:, 1, :2] - boxes[:, 0, :2], axis=1)
    is_body = np.all(ground >= np.array(sizes.body) - 1e-6, axis=1)
    largest_first = [int(n) for n in np.argsort(-ground.prod(axis=1), kind="stable")]
    groups: list[_PartGroup] = []
    for n in largest_first:
        if is_body[n] and not _join(groups, n, boxes, names, sizes, body=True):
            groups.append(_PartGroup([n], [n], boxes[n]))
    loose = [n for n in largest_first if not is_body[n]]
    for _ in range(MAX_STEPS):
        loose = [n for n in loose if not _join(groups, n, boxes, names, sizes, body=False)]
    return [whole.members for whole in groups if len(whole.members) > 1]


def _join(groups: list[_PartGroup], n: int, boxes: Boxes, names: Sequence[str], sizes: Sizes, *, body: bool) -> bool:
    """Adds part ``n`` to the group whose box grows least by it. Returns False if the part fits no group."""
    if not groups:
        return False
    box = boxes[n]
    those = np.array([whole.box for whole in groups])
    low, high = np.minimum(those[:, 0], box[0]), np.maximum(those[:, 1], box[1])
    gap = np.maximum(those[:, 0], box[0]) - np.minimum(those[:, 1], box[1])
    joint = high - low
    fits = (
        (gap <= TOUCH_M).all(axis=1)
        & (joint[:, :2].max(axis=1) <= sizes.max_size[0])
        & (joint[:, 2] <= sizes.max_size[1])
    )
    if body:
        shared = np.maximum(-gap[:, :2], 0).prod(axis=1)
        smaller = np.minimum((those[:, 1] - those[:, 0])[:, :2].prod(axis=1), (box[1] - box[0])[:2].prod())
        fits &= shared >= MIN_SHARED_GROUND * smaller
    grown = joint - (those[:, 1] - those[:, 0])
    # A leg belongs to the seat above it before it belongs to the chair beside it.
    rank = np.lexsort((grown[:, 2], grown[:, :2].sum(axis=1)))
    for index in rank[fits[rank]]:
        whole = groups[index]
        if not (body and _are_two(boxes, names, n, whole.bodies)):
            bodies = [*whole.bodies, n] if body else whole.bodies
            groups[index] = _PartGroup([*whole.members, n], bodies, np.stack([low[index], high[index]]))
            return True
    return False


def _are_two(boxes: Boxes, names: Sequence[str], n: int, others: Sequence[int]) -> bool:
    """Whether a body is another thing than one of ``others``: two of one size stand side by side, or two of one size and name
    lie above each other (stacked chairs)."""
    those, box = boxes[others], boxes[n]
    sizes, size = those[:, 1] - those[:, 0], box[1] - box[0]
    sizes[:, :2].sort(axis=1)
    size[:2].sort()
    alike = (np.abs(sizes - size) <= SAME_SIZE * np.maximum(sizes, size) + 1e-3).all(axis=1)
    apart = np.abs(those.mean(axis=1) - box.mean(axis=0)) > TOUCH_M
    namesakes = np.array([names[other] == names[n] for other in others])
    return bool((alike & (apart[:, :2].any(axis=1) | (apart[:, 2] & namesakes))).any())


def _merged(parts: Sequence[MeshPart], kind: str) -> MeshPart | None:
    """Merges parts into one piece, named by the words that all their names begin with. Returns None if no name says the class
    at the size of the whole."""
    meshes = tuple(mesh for part in parts for mesh in part.meshes)
    low, high = box_of(meshes)
    size = point3(high - low)
    words = zip(*(re.split(r"(?<=[_.\-\s])", part.name) for part in parts), strict=False)
    common = "".join(word[0] for word in takewhile(lambda same: len(set(same)) == 1, words)).rstrip("_.- ")
    name = next((n for n in (common, *(part.name for part in parts)) if label_of_node(n, size) == kind), None)
    return None if name is None else replace(parts[0], name=name, meshes=meshes)


def box_of(meshes: Sequence[Mesh]) -> NDArray[np.float64]:
    """The smallest axis-aligned box around all of the meshes: (2, 3), its low and its high corner, in the frame and unit of
    their vertices. There must be at least one mesh."""
    low = np.min([mesh.vertices.min(axis=0) for mesh in meshes], axis=0)
    high = np.max([mesh.vertices.max(axis=0) for mesh in meshes], axis=0)
    return np.array([low, high], dtype=np.float64)
