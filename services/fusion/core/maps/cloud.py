"""The joint point cloud: voxels with a mean position and colour, who saw them when, and whether they are still there.

The paper's section IV-C.1.

Voxels stand one after the other in an array; blocks of 4x4x4 voxels know where theirs stand, and regions of 8x8x8
blocks know their blocks. The cost of a point doesn't depend on the size of the map, and neither does that of a view
that looks for voxels which it sees through: it asks the regions before it only.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.fusion.core.config import MapConfig
from surveilnav.services.fusion.core.maps import voxels
from surveilnav.services.fusion.core.maps.carving import FreeDepthImage
from surveilnav.services.fusion.core.maps.provenance import MAX_SETS, SourceSets
from surveilnav.services.fusion.core.maps.voxels import BITS, HALF, MASK, NEVER, VOXEL


class VoxelCloud:
    """Mean positions and colours of voxels, their provenance, and which of them are gone.

    A point weighs in by the inverse of its depth's variance (``MapConfig.depth_noise_m``), quantised to 1..64. Up to
    a weight of 16.8 million (a quarter of a million points near by) means are exact; then they stand.
    A voxel is gone while ``carve_views`` views that are newer than its last point see through it; gone voxels are
    left out of everything, and make room when the cloud is full.

    Attributes:
        refused: points that had no place, because the cloud was full or they lay outside the world.
        n_gone: voxels that are kept, but gone.
    """

    def __init__(self, config: MapConfig) -> None:
        self._config = config
        self._voxels = np.zeros(1 << 12, VOXEL)
        self._index = voxels.new_index(1 << 10)
        self._n = 0
        self._max_blocks = config.max_voxels // 4 + 1024  # a surface fills eight of a block's voxels or more
        self._sets = SourceSets()
        self._joined = np.full(MAX_SETS, -1, np.int32)  # scratch: set -> set with the view's source
        self.n_gone = 0
        self.refused = 0

    @property
    def size(self) -> int:
        """Voxels that are there."""
        return self._n - self.n_gone

    def add(
        self,
        p_world: NDArray[np.float32],
        colours: NDArray[np.uint8],
        p_camera: NDArray[np.float64],
        source: str,
        stamp_ns: int,
    ) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Adds points (N, 3) [m, world] with colours (N, 3) uint8, seen by ``source`` from ``p_camera`` (3,).

        Returns the numbers of new voxels, and of those that were gone and are back.
        """
        c = self._config
        n = len(p_world)
        if self._n + n > c.max_voxels and self.n_gone > c.max_voxels // 16:
            self._drop_gone()
        self._reserve(n)
        hits, back = np.empty(n, np.int32), np.empty(n, np.int32)
        before = self._n
        per_m = 1.0 / c.voxel_m
        self._n = voxels.find(
            self._voxels, self._index, self._n, c.max_voxels, self._max_blocks, p_world, stamp_ns, per_m, hits
        )
        n_hits, n_back = voxels.add(
            self._voxels,
            hits,
            p_world,
            colours,
            p_camera,
            stamp_ns,
            per_m,
            c.depth_noise_m**2,
            c.depth_noise_per_m**2,
            c.carve_views,
            back,
        )
        self.refused += n - n_hits
        self.n_gone -= n_back
        self._note_source(hits, source)
        return np.arange(before, self._n, dtype=np.int32), back[:n_back].copy()

    def carve(self, view: FreeDepthImage) -> NDArray[np.int32]:
        """Notes what a view sees through; returns the numbers of the voxels that are gone by it."""
        gone = np.empty(self._n, np.int32)  # pages that nobody writes to cost nothing
        c = self._config
        n = voxels.carve(
            self._voxels,
            self._index,
            view.camera,
            view.limit_m,
            view.far_m,
            view.stamp_ns,
            c.voxel_m,
            c.carve_views,
            gone,
        )
        self.n_gone += n
        return gone[:n].copy()

    def recheck(self, new: NDArray[np.int32], newer: Iterable[FreeDepthImage]) -> NDArray[np.int32]:
        """Asks views that came before these voxels did; returns the numbers of those that are gone at once."""
        c, found = self._config, [np.empty(0, np.int32)]
        for view in newer:
            gone = np.empty(len(new), np.int32)
            n = voxels.recheck(
                self._voxels, new, view.camera, view.limit_m, view.stamp_ns, c.voxel_m, c.carve_views, gone
            )
            found.append(gone[:n])
        gone = np.concatenate(found)
        self.n_gone += len(gone)
        return gone

    def array(self) -> NDArray[np.float32]:
        """(N, 6) float32: mean positions [m, world] and colours 0-1 of the voxels that are there, in no order."""
        out = np.empty((self.size, 6), np.float32)
        voxels.means(self._voxels[: self._n], self._config.voxel_m, self._config.carve_views, out)
        return out

    def provenance(
        self,
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], list[list[str]]]:
        """Who saw the voxels of ``array``, line by line: number of a set of sources (N,), first and last seen [ns].

        The last part is the sets by number: sorted names of robots and cameras, or ``["many"]`` beyond 65,535 sets.
        """
        there = self._voxels[: self._n][~self._is_gone()]
        first_ns, last_ns = there["first_ns"].copy(), there["last_ns"].copy()
        return there["sources"].astype(np.int64), first_ns, last_ns, self.source_sets()

    def source_sets(self) -> list[list[str]]:
        """The sets that ``provenance`` counts by."""
        return self._sets.lists()

    def centres(self, numbers: NDArray[np.int32]) -> NDArray[np.float64]:
        """Centres (N, 3) [m, world] of voxels by number."""
        return voxel_centres(self._voxels["key"][numbers], self._config.voxel_m)

    def state(self) -> dict[str, Any]:
        """All of it, as plain arrays and numbers, for ``from_state``."""
        columns = {name: self._voxels[name][: self._n].copy() for name in VOXEL.names or ()}
        return {"voxels": columns, "sets": self._sets.lists(), "refused": self.refused}

    @classmethod
    def from_state(cls, state: dict[str, Any], config: MapConfig) -> VoxelCloud:
        """The cloud that ``state`` was taken of, under the same ``config``."""
        cloud = cls(config)
        cloud._n = len(state["voxels"]["key"])
        cloud._voxels = np.zeros(max(len(cloud._voxels), cloud._n), VOXEL)
        for name in VOXEL.names or ():
            cloud._voxels[name][: cloud._n] = state["voxels"][name]
        cloud._sets = SourceSets.from_lists(state["sets"])
        cloud._rebuild_index()
        cloud.n_gone = int(np.count_nonzero(cloud._is_gone()))
        cloud.refused = int(state["refused"])
        return cloud

    def _is_gone(self) -> NDArray[np.bool_]:
        used = self._voxels[: self._n]
        deciding = {0: None, 1: "through_ns", 2: "through_before_ns"}[self._config.carve_views]
        if deciding is None:
            return np.zeros(self._n, np.bool_)
        return np.asarray(used[deciding] != NEVER)

    def _note_source(self, hits: NDArray[np.int32], source: str) -> None:
        wanted = voxels.sets_of(self._voxels, hits, self._joined)
        joined = np.array([self._sets.join(int(number), source) for number in wanted], np.int32)
        self._joined[joined] = joined
        self._joined[wanted] = joined
        if (self._joined[wanted] != wanted).any():
            voxels.set_sources(self._voxels, hits, self._joined)
        self._joined[wanted] = self._joined[joined] = -1

    def _reserve(self, n: int) -> None:
        """Room for ``n`` more voxels, and the blocks they may need."""
        want = min(self._n + n, self._config.max_voxels)
        if want > len(self._voxels):
            larger = np.zeros(max(want, min(2 * len(self._voxels), self._config.max_voxels)), VOXEL)
            larger[: self._n] = self._voxels[: self._n]
            self._voxels = larger
        n_blocks = min(int(self._index.counts[0]) + n, self._max_blocks)
        if n_blocks > len(self._index.block_keys):
            self._index = voxels.grown(self._index, max(n_blocks, 2 * len(self._index.block_keys)))

    def _drop_gone(self) -> None:
        kept = self._voxels[: self._n][~self._is_gone()]
        self._n, self.n_gone = len(kept), 0
        self._voxels[: self._n] = kept
        self._rebuild_index()

    def _rebuild_index(self) -> None:
        """Finds all voxels anew."""
        self._index = voxels.new_index(1 << 10)
        for start in range(0, self._n, 1 << 16):
            stop = min(start + (1 << 16), self._n)
            n_blocks = int(self._index.counts[0]) + stop - start
            if n_blocks > len(self._index.block_keys):
                self._index = voxels.grown(self._index, max(n_blocks, 2 * len(self._index.block_keys)))
            voxels.enter(self._voxels, self._index, start, stop)


def voxel_keys(p_world: NDArray[np.floating], voxel_m: float) -> NDArray[np.int64]:
    """Sorted unique keys (M,) int64 of the voxels that points (N, 3) [m, world] lie in."""
    i = np.floor(np.asarray(p_world, np.float64) / voxel_m).astype(np.int64) + HALF
    return sorted_unique((i[:, 2] << (2 * BITS)) | (i[:, 1] << BITS) | i[:, 0])


def sorted_unique(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """``numpy.unique`` without its hash table, which is slower for the few thousand keys of an object."""
    keys = np.sort(keys)
    first = np.ones(len(keys), np.bool_)
    first[1:] = keys[1:] != keys[:-1]
    return keys[first]


def voxel_centres(keys: NDArray[np.int64], voxel_m: float) -> NDArray[np.float64]:
    """Centres (N, 3) [m, world] of voxels."""
    i = np.stack([keys & MASK, (keys >> BITS) & MASK, keys >> (2 * BITS)], axis=-1) - HALF
    return np.asarray((i + 0.5) * voxel_m)
