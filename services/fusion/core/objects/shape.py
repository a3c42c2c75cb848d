"""The shape of a detection or an object: its points as voxels, fine ones for the shape and coarse ones for overlaps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.fusion.core.maps.cloud import sorted_unique, voxel_centres, voxel_keys

Keys = NDArray[np.int64]
_MAX_SAMPLES = 64


class Shape:
    """The voxels that contain the points of a detection or an object. Immutable.

    Attributes:
        keys: (N,) int64, sorted and unique keys of the fine voxels (2.5 cm).
        coarse: (M,) int64, sorted and unique keys of the coarse voxels, for ``association.overlaps``.
        p_min, p_max: (3,) float64, corners of the axis-aligned box of the fine voxels [m, world].
    """

    __slots__ = ("_samples", "coarse", "coarse_m", "keys", "p_max", "p_min", "voxel_m")

    def __init__(self, keys: Keys, voxel_m: float, coarse_m: float) -> None:
        self.keys, self.voxel_m, self.coarse_m = keys, voxel_m, coarse_m
        centres = voxel_centres(keys, voxel_m)
        self.coarse = voxel_keys(centres, coarse_m)
        self.p_min = centres.min(axis=0) - voxel_m / 2
        self.p_max = centres.max(axis=0) + voxel_m / 2
        self._samples: NDArray[np.float64] | None = None

    @classmethod
    def from_points(cls, p_world: NDArray[np.floating], voxel_m: float, coarse_m: float) -> Shape:
        """The shape of points (N, 3) [m, world], N > 0."""
        return cls(voxel_keys(p_world, voxel_m), voxel_m, coarse_m)

    @property
    def points(self) -> NDArray[np.float64]:
        """Centres of the fine voxels (N, 3) [m, world]."""
        return voxel_centres(self.keys, self.voxel_m)

    @property
    def samples(self) -> NDArray[np.float64]:
        """At most 64 of ``points``, spread evenly over the sorted keys: (n, 3) [m, world]."""
        if self._samples is None:
            self._samples = voxel_centres(self.keys[spread_indices(len(self.keys), _MAX_SAMPLES)], self.voxel_m)
        return self._samples

    @property
    def centre_m(self) -> NDArray[np.float64]:
        """Centre of the box (3,) [m, world]."""
        centre_m: NDArray[np.float64] = (self.p_min + self.p_max) / 2
        return centre_m

    def moved(self, offset_m: NDArray[np.float64]) -> Shape:
        """This shape at another place, moved by (dx, dy) [m]."""
        return Shape.from_points(self.points + np.array([*offset_m, 0.0]), self.voxel_m, self.coarse_m)

    def union(self, other: Shape, max_voxels: int) -> Shape:
        """This shape and another together, limited to ``max_voxels``. All own voxels stay; new ones fill the room left."""
        new = other.keys[~found_in(other.keys, self.keys)]
        if len(new) > max_voxels - len(self.keys):
            new = new[: max(0, max_voxels - len(self.keys))]
        if len(new) == 0:
            return self
        added = Shape(new, self.voxel_m, self.coarse_m)
        both = object.__new__(Shape)  # assembled from its parts, which is cheaper than from all its voxels
        both.keys = np.sort(np.concatenate([self.keys, new]))
        both.coarse = sorted_unique(np.concatenate([self.coarse, added.coarse]))
        both.voxel_m, both.coarse_m, both._samples = self.voxel_m, self.coarse_m, None
        both.p_min = np.minimum(self.p_min, added.p_min)
        both.p_max = np.maximum(self.p_max, added.p_max)
        return both


def spread_indices(n: int, max_indices: int) -> NDArray[np.int64]:
    """At most ``max_indices`` of the indices 0 to n - 1, evenly spaced, including the first and the last."""
    return np.linspace(0, n - 1, min(n, max_indices)).round().astype(np.int64)


def found_in(a: Keys, b: Keys) -> NDArray[np.bool_]:
    """Which elements of a are in b: (len(a),) bool. Both are sorted and unique, and b isn't empty."""
    i = np.searchsorted(b, a)
    i[i == len(b)] = 0
    found: NDArray[np.bool_] = b[i] == a
    return found
