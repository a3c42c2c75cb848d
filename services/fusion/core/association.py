"""Is this detection that object? Geometric and semantic similarity (eq. 3)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from services.fusion.core.cloud import voxel_centres, voxel_keys

Keys = NDArray[np.int64]


class Shape:
    """The points of a detection or an object as voxels.

    Attributes:
        keys: (N,) int64 sorted unique fine voxels (2.5 cm).
        coarse: (M,) int64 sorted unique coarse voxels, for ``overlap``.
        p_min, p_max: (3,) float64, axis-aligned box of the fine voxels [m, world].
    """

    __slots__ = ("coarse", "coarse_m", "keys", "p_max", "p_min", "voxel_m")

    def __init__(self, keys: Keys, voxel_m: float, coarse_m: float) -> None:
        self.keys, self.voxel_m, self.coarse_m = keys, voxel_m, coarse_m
        centres = voxel_centres(keys, voxel_m)
        self.coarse = voxel_keys(centres, coarse_m)
        self.p_min = centres.min(axis=0) - voxel_m / 2
        self.p_max = centres.max(axis=0) + voxel_m / 2

    @classmethod
    def of_points(cls, p_world: NDArray[np.floating], voxel_m: float, coarse_m: float) -> Shape:
        """Of points (N, 3) [m, world], N > 0."""
        return cls(voxel_keys(p_world, voxel_m), voxel_m, coarse_m)

    @property
    def points(self) -> NDArray[np.float64]:
        """Voxel centres (N, 3) [m, world]."""
        return voxel_centres(self.keys, self.voxel_m)

    def union(self, other: Shape, most: int) -> Shape:
        """Both together, at most ``most`` voxels: what is there stays, new ones join while there is room."""
        new = np.setdiff1d(other.keys, self.keys, assume_unique=True)[: max(0, most - len(self.keys))]
        if len(new) == 0:
            return self
        return Shape(np.sort(np.concatenate([self.keys, new])), self.voxel_m, self.coarse_m)


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


def boxes_touch(p_min: NDArray[np.float64], p_max: NDArray[np.float64], a: Shape, margin_m: float) -> NDArray[np.bool_]:
    """Which of the boxes (N, 3), (N, 3) come within ``margin_m`` of a's box."""
    touch: NDArray[np.bool_] = np.all((p_min <= a.p_max + margin_m) & (p_max >= a.p_min - margin_m), axis=1)
    return touch


def _shared(a: Keys, b: Keys) -> int:
    """How many elements of a lie in b; both sorted and unique."""
    i = np.searchsorted(b, a)
    i[i == len(b)] = 0
    return int(np.count_nonzero(b[i] == a)) if len(b) else 0


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
