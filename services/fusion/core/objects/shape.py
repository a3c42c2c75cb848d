"""The points of a detection or an object, as voxels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.fusion.core.maps.cloud import sorted_unique, voxel_centres, voxel_keys

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
        new = other.keys[~found_in(other.keys, self.keys)]
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


def evenly(n: int, most: int) -> NDArray[np.int64]:
    """At most ``most`` of n indices, evenly spaced, the first and the last among them."""
    return np.linspace(0, n - 1, min(n, most)).round().astype(np.int64)


def found_in(a: Keys, b: Keys) -> NDArray[np.bool_]:
    """Which elements of a lie in b; both sorted and unique, b not empty."""
    i = np.searchsorted(b, a)
    i[i == len(b)] = 0
    found: NDArray[np.bool_] = b[i] == a
    return found
