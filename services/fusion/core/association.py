"""Is this detection that object? Geometric and semantic similarity (eq. 3)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from services.fusion.core.cloud import sorted_unique, voxel_centres, voxel_keys

Keys = NDArray[np.int64]
_SAMPLES = 64


class Shape:
    """The points of a detection or an object as voxels.

    Attributes:
        keys: (N,) int64 sorted unique fine voxels (2.5 cm).
        coarse: (M,) int64 sorted unique coarse voxels, for ``overlap``.
        p_min, p_max: (3,) float64, axis-aligned box of the fine voxels [m, world].
    """

    __slots__ = ("_sampled", "coarse", "coarse_m", "keys", "p_max", "p_min", "voxel_m")

    def __init__(self, keys: Keys, voxel_m: float, coarse_m: float) -> None:
        self.keys, self.voxel_m, self.coarse_m = keys, voxel_m, coarse_m
        centres = voxel_centres(keys, voxel_m)
        self.coarse = voxel_keys(centres, coarse_m)
        self.p_min = centres.min(axis=0) - voxel_m / 2
        self.p_max = centres.max(axis=0) + voxel_m / 2
        self._sampled: NDArray[np.float64] | None = None

    @classmethod
    def of_points(cls, p_world: NDArray[np.floating], voxel_m: float, coarse_m: float) -> Shape:
        """Of points (N, 3) [m, world], N > 0."""
        return cls(voxel_keys(p_world, voxel_m), voxel_m, coarse_m)

    @property
    def points(self) -> NDArray[np.float64]:
        """Voxel centres (N, 3) [m, world]."""
        return voxel_centres(self.keys, self.voxel_m)

    @property
    def samples(self) -> NDArray[np.float64]:
        """At most 64 of the voxel centres (n, 3) [m, world], evenly spaced among the sorted keys."""
        if self._sampled is None:
            self._sampled = voxel_centres(self.keys[evenly(len(self.keys), _SAMPLES)], self.voxel_m)
        return self._sampled

    def union(self, other: Shape, most: int) -> Shape:
        """Both together, at most ``most`` voxels: what is there stays, new ones join while there is room."""
        new = other.keys[~_found(other.keys, self.keys)]
        if len(new) > most - len(self.keys):
            new = new[: max(0, most - len(self.keys))]
        if len(new) == 0:
            return self
        added = Shape(new, self.voxel_m, self.coarse_m)
        both = object.__new__(Shape)  # from its parts, not from all of its voxels again
        both.keys = np.sort(np.concatenate([self.keys, new]))
        both.coarse = sorted_unique(np.concatenate([self.coarse, added.coarse]))
        both.voxel_m, both.coarse_m, both._sampled = self.voxel_m, self.coarse_m, None
        both.p_min = np.minimum(self.p_min, added.p_min)
        both.p_max = np.maximum(self.p_max, added.p_max)
        return both


class BoxTable:
    """The boxes of many shapes by id, in arrays: which of them are near is one comparison, however many there are."""

    def __init__(self) -> None:
        self._row: dict[int, int] = {}
        self._ids = np.zeros(16, np.int64)
        self._low, self._high = np.zeros((16, 3)), np.zeros((16, 3))

    def put(self, id_: int, shape: Shape) -> None:
        """Adds a box, or replaces the one of that id."""
        row = self._row.setdefault(id_, len(self._row))
        if row == len(self._ids):
            self._ids, self._low, self._high = (
                np.concatenate([a, np.zeros_like(a)]) for a in (self._ids, self._low, self._high)
            )
        self._ids[row], self._low[row], self._high[row] = id_, shape.p_min, shape.p_max

    def drop(self, id_: int) -> None:
        """Forgets a box; the last one takes its place."""
        row, last = self._row.pop(id_), len(self._row)
        if row != last:
            self._ids[row], self._low[row], self._high[row] = self._ids[last], self._low[last], self._high[last]
            self._row[int(self._ids[row])] = row

    def touching(self, shape: Shape, margin_m: float) -> list[int]:
        """Ids, in order, of the boxes that come within ``margin_m`` of the shape's."""
        n = len(self._row)
        near = (self._low[:n] <= shape.p_max + margin_m) & (self._high[:n] >= shape.p_min - margin_m)
        return sorted(self._ids[:n][near.all(axis=1)].tolist())

    def before(self, T_world_camera: NDArray[np.float64], far_m: float) -> list[int]:
        """Ids, in order, of the boxes whose middle lies before a camera and at most ``far_m`` from it."""
        n = len(self._row)
        middles = (self._low[:n] + self._high[:n]) / 2 - T_world_camera[:3, 3]
        near = (middles @ T_world_camera[:3, 2] > 0) & (np.einsum("ij,ij->i", middles, middles) <= far_m**2)
        return sorted(self._ids[:n][near].tolist())


def evenly(n: int, most: int) -> NDArray[np.int64]:
    """At most ``most`` of n indices, evenly spaced, the first and the last among them."""
    return np.linspace(0, n - 1, min(n, most)).round().astype(np.int64)


def apart(a: Shape, b: Shape, margin_m: float) -> bool:
    """Whether the boxes are farther than ``margin_m`` from each other along some axis: then nothing overlaps."""
    return bool(np.any(a.p_min > b.p_max + margin_m) or np.any(b.p_min > a.p_max + margin_m))


def box_overlap(a: Shape, b: Shape) -> float:
    """Share of the smaller axis-aligned box that lies in the other: front and back of one thing share no points."""
    inside = np.prod(np.clip(np.minimum(a.p_max, b.p_max) - np.maximum(a.p_min, b.p_min), 0.0, None))
    return float(inside / min(np.prod(a.p_max - a.p_min), np.prod(b.p_max - b.p_min)))


def box_iou(a: Shape, b: Shape) -> float:
    """Intersection over union of the axis-aligned boxes: what VLN-Game's 1.35 was tuned with."""
    inside = np.prod(np.clip(np.minimum(a.p_max, b.p_max) - np.maximum(a.p_min, b.p_min), 0.0, None))
    both = np.prod(a.p_max - a.p_min) + np.prod(b.p_max - b.p_min) - inside
    return float(inside / both)


def voxel_iou(a: Shape, b: Shape) -> float:
    """Intersection over union of the fine voxels: the paper's words."""
    inside = _shared(a.keys, b.keys)
    return inside / (len(a.keys) + len(b.keys) - inside)


def overlaps(a: Shape, b: Shape) -> tuple[float, float]:
    """Share of a's coarse voxels with one of b's beside them, and the reverse: ConceptGraphs' ratio, both ways."""
    return _beside(a.coarse, b.coarse) / len(a.coarse), _beside(b.coarse, a.coarse) / len(b.coarse)


def cosine(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    """Cosine similarity; 0 where the vectors come from different models or are nothing."""
    if a.shape != b.shape:
        return 0.0
    length = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / length if length > 0 else 0.0


def _shared(a: Keys, b: Keys) -> int:
    """How many elements of a lie in b; both sorted and unique."""
    return int(np.count_nonzero(_found(a, b)))


def _found(a: Keys, b: Keys) -> NDArray[np.bool_]:
    """Which elements of a lie in b; both sorted and unique, b not empty."""
    i = np.searchsorted(b, a)
    i[i == len(b)] = 0
    found: NDArray[np.bool_] = b[i] == a
    return found


@njit(cache=True, nogil=True)
def _beside(a, b):  # type: ignore[no-untyped-def]
    """How many voxels of a have one of b among the 27 at and around them; both sorted and unique."""
    n = 0
    for key in a:
        found = False
        for z in (0, -1, 1):
            for y in (0, -1, 1):
                low = key + z * (np.int64(1) << 42) + y * (np.int64(1) << 21) - 1
                i = np.searchsorted(b, low)  # three neighbours along x are three keys in a row
                if i < len(b) and b[i] <= low + 2:
                    found = True
                    break
            if found:
                break
        n += found
    return n
