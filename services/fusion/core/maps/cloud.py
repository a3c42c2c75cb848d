"""The joint point cloud (the paper's section IV-C.1): voxels with mean position and colour, who saw them when, and carving.

Voxels are stored in one array. A spatial hash (``Index``) finds them by blocks of 4x4x4 voxels, and blocks by regions of
8x8x8 blocks. So the cost of adding a point doesn't depend on the size of the map, and neither does that of carving by a view,
which only looks at the regions in front of it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Set
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.fusion.core.config import MapConfig
from surveilnav.services.fusion.core.maps import voxels
from surveilnav.services.fusion.core.maps.carving import FreeDepthImage
from surveilnav.services.fusion.core.maps.provenance import MAX_SETS, Agreement, SourceSets
from surveilnav.services.fusion.core.maps.voxel_index import grow_index, new_index
from surveilnav.services.fusion.core.maps.voxels import BITS, HALF, MASK, NEVER, VOXEL


class VoxelCloud:
    """Voxels with their mean positions, colours and provenance, and which of them are carved away.

    A point is weighted by the inverse variance of its depth (``MapConfig.depth_noise_m``), quantised to 1-64. Means are exact
    up to a total weight of 16.8 million (a quarter of a million points at close range), from which they no longer change.
    A voxel is carved away while ``carve_views`` views newer than its last point see through it. Carved voxels are left out of
    everything, and are removed when the cloud is full.

    Attributes:
        refused: number of points that were dropped because the cloud was full or they lay outside the world.
        n_carved: number of voxels that are stored but carved away.
    """

    def __init__(self, config: MapConfig) -> None:
        self._config = config
        self._voxels = np.zeros(1 << 12, VOXEL)
        self._index = new_index(1 << 10)
        self._n = 0
        self._max_blocks = config.max_voxels // 4 + 1024  # a surface fills at least eight voxels of a block
        self._sets = SourceSets()
        self._set_with_source = np.full(MAX_SETS, -1, np.int32)  # scratch: set -> set with the view's source too
        self.n_carved = 0
        self.refused = 0

    @property
    def size(self) -> int:
        """The number of voxels that aren't carved away."""
        return self._n - self.n_carved

    def add(
        self,
        p_world: NDArray[np.float32],
        colours: NDArray[np.uint8],
        p_camera: NDArray[np.float64],
        source: str,
        stamp_ns: int,
    ) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Adds the points of a view.

        Args:
            p_world: (N, 3) points [m, world].
            colours: (N, 3) uint8.
            p_camera: (3,) position of the camera [m, world].

        Returns:
            The numbers of new voxels, and of carved voxels that are restored.
        """
        c = self._config
        n = len(p_world)
        if self._n + n > c.max_voxels and self.n_carved > c.max_voxels // 16:
            self._remove_carved()
        self._reserve(n)
        hits, restored = np.empty(n, np.int32), np.empty(n, np.int32)
        n_before = self._n
        per_m = 1.0 / c.voxel_m
        self._n = voxels.find_or_create(
            self._voxels, self._index, self._n, c.max_voxels, self._max_blocks, p_world, stamp_ns, per_m, hits
        )
        n_hits, n_restored = voxels.add_points(
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
            restored,
        )
        self.refused += n - n_hits
        self.n_carved -= n_restored
        self._record_source(hits, source)
        return np.arange(n_before, self._n, dtype=np.int32), restored[:n_restored].copy()

    def carve(self, image: FreeDepthImage) -> NDArray[np.int32]:
        """Carves the cloud by what a view sees through; returns the numbers of the voxels that are carved away by it."""
        carved = np.empty(self._n, np.int32)  # memory pages that aren't written to cost nothing
        c = self._config
        n = voxels.carve(
            self._voxels,
            self._index,
            image.camera,
            image.free_depth_m,
            image.coarse_max_m,
            image.stamp_ns,
            c.voxel_m,
            c.carve_views,
            carved,
        )
        self.n_carved += n
        return carved[:n].copy()

    def carve_listed(self, numbers: NDArray[np.int32], images: Iterable[FreeDepthImage]) -> NDArray[np.int32]:
        """Carves the listed voxels by views that came before them; returns the numbers of those that are carved away."""
        c, parts = self._config, [np.empty(0, np.int32)]
        for image in images:
            carved = np.empty(len(numbers), np.int32)
            n = voxels.carve_listed(
                self._voxels,
                numbers,
                image.camera,
                image.free_depth_m,
                image.stamp_ns,
                c.voxel_m,
                c.carve_views,
                carved,
            )
            parts.append(carved[:n])
        all_carved = np.concatenate(parts)
        self.n_carved += len(all_carved)
        return all_carved

    def array(self) -> NDArray[np.float32]:
        """(N, 6) float32: mean positions [m, world] and colours (0-1) of the voxels that aren't carved, in any order."""
        out = np.empty((self.size, 6), np.float32)
        voxels.write_means(self._voxels[: self._n], self._config.voxel_m, self._config.carve_views, out)
        return out

    def provenance(
        self,
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], list[list[str]]]:
        """Who saw the voxels of ``array``, and when, line by line with it.

        Returns:
            The number of the source set (N,), the stamps of the first and the last point (N,), (N,) [ns], and the sets by
            number: sorted names of robots and cameras, or ``["many"]`` beyond 65,535 sets.
        """
        present = self._voxels[: self._n][~self._is_carved()]
        first_ns, last_ns = present["first_ns"].copy(), present["last_ns"].copy()
        return present["sources"].astype(np.int64), first_ns, last_ns, self.source_sets()

    def source_sets(self) -> list[list[str]]:
        """The source sets by number, as in ``provenance``."""
        return self._sets.lists()

    def agreement(self, current_since_ns: Mapping[str, int], within_ns: int) -> dict[str, Agreement]:
        """How far what each source has measured agrees with what others have seen.

        Args:
            current_since_ns: by source, since when its points are current [ns]: it has not looked there again since. Where it
                has, what it saw before may have been moved away. A source that isn't named has always been current.
            within_ns: others must have looked through a point so soon after it was seen. Later, it may have been moved away.
        """
        used = self._voxels[: self._n]
        sources, is_carved = used["sources"], self._is_carved()
        sets = self._sets.lists()
        since_ns = np.array([max((current_since_ns.get(m, NEVER) for m in members), default=NEVER) for members in sets])
        looked_through_ns = used["seen_through_before_ns" if self._config.carve_views == 2 else "seen_through_ns"]
        is_refuted = (
            is_carved & (looked_through_ns - used["last_ns"] <= within_ns) & (used["last_ns"] >= since_ns[sources])
        )
        refuted = np.bincount(sources[is_refuted], minlength=len(sets))
        present = np.bincount(sources[~is_carved], minlength=len(sets))
        n_refuted = {members[0]: int(n) for members, n in zip(sets, refuted, strict=True) if len(members) == 1}
        n_confirmed: Counter[str] = Counter()
        for members, n in zip(sets, present, strict=True):
            if len(members) > 1:
                n_confirmed.update(dict.fromkeys(members, int(n)))
        return {name: Agreement(n_refuted.get(name, 0), n_confirmed[name]) for name in {*n_refuted, *n_confirmed}}

    def measured_by(self, sources: Set[str]) -> NDArray[np.float64]:
        """Centres (N, 3) [m, world] of the voxels that any of the sources has measured, even where others look through them."""
        is_its = np.array([not sources.isdisjoint(members) for members in self._sets.lists()])
        used = self._voxels[: self._n]
        return voxel_centres(used["key"][is_its[used["sources"]]], self._config.voxel_m)

    def measured_by_others(self, source: str) -> NDArray[np.float64]:
        """Centres (N, 3) [m, world] of the voxels that others than a source have measured, and that aren't carved away."""
        is_others = np.array([any(name != source for name in members) for members in self._sets.lists()])
        used = self._voxels[: self._n]
        chosen = is_others[used["sources"]] & ~self._is_carved()
        return voxel_centres(used["key"][chosen], self._config.voxel_m)

    def centres(self, numbers: NDArray[np.int32]) -> NDArray[np.float64]:
        """Centres (N, 3) [m, world] of the voxels with these numbers (N,)."""
        return voxel_centres(self._voxels["key"][numbers], self._config.voxel_m)

    def state(self) -> dict[str, Any]:
        """Everything as plain arrays and numbers, for ``from_state``."""
        columns = {name: self._voxels[name][: self._n].copy() for name in VOXEL.names or ()}
        return {"voxels": columns, "sets": self._sets.lists(), "refused": self.refused}

    @classmethod
    def from_state(cls, state: dict[str, Any], config: MapConfig) -> VoxelCloud:
        cloud = cls(config)
        cloud._n = len(state["voxels"]["key"])
        cloud._voxels = np.zeros(max(len(cloud._voxels), cloud._n), VOXEL)
        for name in VOXEL.names or ():
            cloud._voxels[name][: cloud._n] = state["voxels"][name]
        cloud._sets = SourceSets.from_lists(state["sets"])
        cloud._rebuild_index()
        cloud.n_carved = int(np.count_nonzero(cloud._is_carved()))
        cloud.refused = int(state["refused"])
        return cloud

    def _is_carved(self) -> NDArray[np.bool_]:
        used = self._voxels[: self._n]
        deciding = {0: None, 1: "seen_through_ns", 2: "seen_through_before_ns"}[self._config.carve_views]
        if deciding is None:
            return np.zeros(self._n, np.bool_)
        return np.asarray(used[deciding] != NEVER)

    def _record_source(self, hits: NDArray[np.int32], source: str) -> None:
        """Adds a source to the source sets of the voxels ``hits``."""
        former = voxels.source_sets_of(self._voxels, hits, self._set_with_source)
        new = np.array([self._sets.with_source(int(number), source) for number in former], np.int32)
        self._set_with_source[new] = new
        self._set_with_source[former] = new
        if (self._set_with_source[former] != former).any():
            voxels.replace_source_sets(self._voxels, hits, self._set_with_source)
        self._set_with_source[former] = self._set_with_source[new] = -1

    def _reserve(self, n: int) -> None:
        """Makes room for ``n`` more voxels and the blocks that they may need."""
        want = min(self._n + n, self._config.max_voxels)
        if want > len(self._voxels):
            larger = np.zeros(max(want, min(2 * len(self._voxels), self._config.max_voxels)), VOXEL)
            larger[: self._n] = self._voxels[: self._n]
            self._voxels = larger
        n_blocks = min(int(self._index.counts[0]) + n, self._max_blocks)
        if n_blocks > len(self._index.block_keys):
            self._index = grow_index(self._index, max(n_blocks, 2 * len(self._index.block_keys)))

    def _remove_carved(self) -> None:
        kept = self._voxels[: self._n][~self._is_carved()]
        self._n, self.n_carved = len(kept), 0
        self._voxels[: self._n] = kept
        self._rebuild_index()

    def _rebuild_index(self) -> None:
        self._index = new_index(1 << 10)
        for start in range(0, self._n, 1 << 16):
            stop = min(start + (1 << 16), self._n)
            n_blocks = int(self._index.counts[0]) + stop - start
            if n_blocks > len(self._index.block_keys):
                self._index = grow_index(self._index, max(n_blocks, 2 * len(self._index.block_keys)))
            voxels.index_voxels(self._voxels, self._index, start, stop)


def voxel_keys(p_world: NDArray[np.floating], voxel_m: float) -> NDArray[np.int64]:
    """Sorted and unique keys (M,) int64 of the voxels that contain points (N, 3) [m, world]."""
    i = np.floor(np.asarray(p_world, np.float64) / voxel_m).astype(np.int64) + HALF
    return sorted_unique((i[:, 2] << (2 * BITS)) | (i[:, 1] << BITS) | i[:, 0])


def sorted_unique(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """``numpy.unique``, but by sorting, which is faster than its hash table for the few thousand keys of an object."""
    keys = np.sort(keys)
    first = np.ones(len(keys), np.bool_)
    first[1:] = keys[1:] != keys[:-1]
    return keys[first]


def voxel_centres(keys: NDArray[np.int64], voxel_m: float) -> NDArray[np.float64]:
    """Centres (N, 3) [m, world] of the voxels with these keys (N,)."""
    i = np.stack([keys & MASK, (keys >> BITS) & MASK, keys >> (2 * BITS)], axis=-1) - HALF
    return np.asarray((i + 0.5) * voxel_m)
