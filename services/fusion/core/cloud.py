"""The joint point cloud: coloured voxels in a hash table. Cost per point doesn't depend on the size of the map."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

_KEY, _COUNT, _RED_GREEN, _BLUE = 0, 1, 2, 3  # columns of the table; key 0: an empty slot (that corner is refused)
_BITS = 21  # per axis: +-26 km at 2.5 cm
_HALF = 1 << (_BITS - 1)
_MASK = (1 << _BITS) - 1


class VoxelCloud:
    """Counts and mean colours of voxels. Sums of integers: the order of views doesn't matter.

    Open addressing with linear probing; the 64 voxels of a 4x4x4 block share a stretch of slots, so that
    neighbouring pixels find their voxels in the processor's cache.
    """

    def __init__(self, voxel_m: float, max_voxels: int) -> None:
        self._voxel_m = voxel_m
        self._max_voxels = max_voxels
        self._table = np.zeros((1 << 16, 4), np.int64)  # 32 bytes a slot: one line of the cache
        self.size = 0
        self.refused = 0

    def add(self, p_world: NDArray[np.float32], colours: NDArray[np.uint8]) -> None:
        """Adds points (N, 3) [m, world] with colours (N, 3) uint8."""
        while 2 * min(self.size + len(p_world), self._max_voxels) > len(self._table):
            self._table = _rehash(self._table, 4 * len(self._table))
        self.size, refused = _add(self._table, self.size, self._max_voxels, p_world, colours, 1.0 / self._voxel_m)
        self.refused += refused

    def array(self) -> NDArray[np.float32]:
        """(N, 6) float32: centres of the voxels [m, world] and colours 0-1, in no particular order."""
        used = self._table[self._table[:, _KEY] != 0]
        out = np.empty((len(used), 6), np.float32)
        out[:, :3] = voxel_centres(used[:, _KEY], self._voxel_m)
        red_green = used[:, _RED_GREEN]
        sums = np.stack([red_green >> 32, red_green & 0xFFFFFFFF, used[:, _BLUE]], axis=-1)
        out[:, 3:] = sums / (255.0 * used[:, _COUNT, None])
        return out


def voxel_keys(p_world: NDArray[np.floating], voxel_m: float) -> NDArray[np.int64]:
    """Sorted unique keys (M,) int64 of the voxels that points (N, 3) [m, world] lie in."""
    i = np.floor(np.asarray(p_world, np.float64) / voxel_m).astype(np.int64) + _HALF
    return sorted_unique((i[:, 2] << (2 * _BITS)) | (i[:, 1] << _BITS) | i[:, 0])


def sorted_unique(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """``numpy.unique`` without its hash table, which is slower for the few thousand keys of an object."""
    keys = np.sort(keys)
    first = np.ones(len(keys), np.bool_)
    first[1:] = keys[1:] != keys[:-1]
    return keys[first]


def voxel_centres(keys: NDArray[np.int64], voxel_m: float) -> NDArray[np.float64]:
    """Centres (N, 3) [m, world] of voxels."""
    i = np.stack([keys & _MASK, (keys >> _BITS) & _MASK, keys >> (2 * _BITS)], axis=-1) - _HALF
    return np.asarray((i + 0.5) * voxel_m)


@njit(cache=True, nogil=True)
def _slot(table, x, y, z, key):  # type: ignore[no-untyped-def]
    """Index of the voxel's slot, or of the empty one where it belongs."""
    mask = np.int64(len(table) - 1)
    block = (x >> 2) * np.int64(73856093) ^ (y >> 2) * np.int64(19349663) ^ (z >> 2) * np.int64(83492791)
    block ^= block >> 15
    slot = (block * 64 + ((z & 3) << 4 | (y & 3) << 2 | (x & 3))) & mask
    while table[slot, _KEY] != 0 and table[slot, _KEY] != key:
        slot = (slot + 1) & mask
    return slot


@njit(cache=True, nogil=True)
def _add(table, size, max_size, points, colours, per_m):  # type: ignore[no-untyped-def]
    refused = 0
    for i in range(points.shape[0]):
        x = np.int64(np.floor(np.float64(points[i, 0]) * per_m)) + _HALF
        y = np.int64(np.floor(np.float64(points[i, 1]) * per_m)) + _HALF
        z = np.int64(np.floor(np.float64(points[i, 2]) * per_m)) + _HALF
        if not (0 < x <= _MASK and 0 <= y <= _MASK and 0 <= z <= _MASK):
            refused += 1
            continue
        key = (z << (2 * _BITS)) | (y << _BITS) | x
        slot = _slot(table, x, y, z, key)
        if table[slot, _KEY] == 0:
            if size >= max_size:
                refused += 1
                continue
            table[slot, _KEY] = key
            size += 1
        if table[slot, _COUNT] < 16_000_000:  # 255 times this still fits 32 bits
            table[slot, _COUNT] += 1
            table[slot, _RED_GREEN] += (np.int64(colours[i, 0]) << 32) + np.int64(colours[i, 1])
            table[slot, _BLUE] += colours[i, 2]
    return size, refused


@njit(cache=True, nogil=True)
def _rehash(table, capacity):  # type: ignore[no-untyped-def]
    larger = np.zeros((capacity, 4), np.int64)
    for i in range(len(table)):
        key = table[i, _KEY]
        if key != 0:
            slot = _slot(larger, key & _MASK, (key >> _BITS) & _MASK, key >> (2 * _BITS), key)
            larger[slot] = table[i]
    return larger
