"""The inner loops of the point cloud, compiled: where voxels stand, points that are added, views that see through.

They stand in one file because what one of them is compiled to is kept until this file changes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

BITS = 21  # per axis: +-26 km at 2.5 cm
HALF = 1 << (BITS - 1)
MASK = (1 << BITS) - 1
NEVER = -(1 << 63)

#: A voxel: sums over its points of weights, weighted offsets in its cube (0-255) and weighted colours, all integers,
#: so that the order of views doesn't matter; the set of its sources; its first and last point; and the two newest
#: views, newer than its last point, that see through it (``NEVER``: none).
VOXEL = np.dtype(
    [
        ("key", np.int64),
        ("weight", np.uint32),
        ("x", np.uint32),
        ("y", np.uint32),
        ("z", np.uint32),
        ("red", np.uint32),
        ("green", np.uint32),
        ("blue", np.uint32),
        ("sources", np.uint32),
        ("first_ns", np.int64),
        ("last_ns", np.int64),
        ("through_ns", np.int64),
        ("through_before_ns", np.int64),
    ]
)
_MAX_WEIGHT = 64  # of one point
_FULL = 16_800_000  # weight at which a voxel's mean stands: 255 times this fits 32 bits
FAR_CELLS = 2  # cells across one of the coarse picture (carving.FreeDepthImage)


class Index(NamedTuple):
    """Where voxels stand. Hash tables hold numbers plus one, 0 where a slot is empty."""

    counts: NDArray[np.int64]  # blocks, regions
    block_keys: NDArray[np.int64]
    block_voxels: NDArray[np.int32]  # (n, 64): number of the voxel plus one, 0: none
    block_next: NDArray[np.int32]  # the next block of its region plus one
    block_slots: NDArray[np.int32]
    region_keys: NDArray[np.int64]
    region_first: NDArray[np.int32]  # its first block plus one
    region_slots: NDArray[np.int32]


def new_index(n_blocks: int) -> Index:
    """An empty index with room for so many blocks."""
    slots = 1 << (2 * n_blocks - 1).bit_length()
    return Index(
        np.zeros(2, np.int64),
        np.zeros(n_blocks, np.int64),
        np.zeros((n_blocks, 64), np.int32),
        np.zeros(n_blocks, np.int32),
        np.zeros(slots, np.int32),
        np.zeros(n_blocks, np.int64),
        np.zeros(n_blocks, np.int32),
        np.zeros(slots, np.int32),
    )


def grown(index: Index, n_blocks: int) -> Index:
    """A copy of an index with room for so many blocks."""
    larger = new_index(n_blocks)
    larger.counts[:] = index.counts
    blocks, regions = index.counts
    larger.block_keys[:blocks] = index.block_keys[:blocks]
    larger.block_voxels[:blocks] = index.block_voxels[:blocks]
    larger.block_next[:blocks] = index.block_next[:blocks]
    larger.region_keys[:regions] = index.region_keys[:regions]
    larger.region_first[:regions] = index.region_first[:regions]
    _hash_all(larger.block_keys[:blocks], larger.block_slots)
    _hash_all(larger.region_keys[:regions], larger.region_slots)
    return larger


@njit(cache=True, nogil=True, inline="always")
def _slot(keys, slots, key):  # type: ignore[no-untyped-def]
    """The slot of a key, or the empty one where it belongs (linear probing)."""
    mask = np.int64(len(slots) - 1)
    h = key * np.int64(-7046029254386353131)  # 2^64 / golden ratio
    slot = (h ^ (h >> 29)) & mask
    while slots[slot] != 0 and keys[slots[slot] - 1] != key:
        slot = (slot + 1) & mask
    return slot


@njit(cache=True, nogil=True)
def _hash_all(keys, slots):  # type: ignore[no-untyped-def]
    for i in range(len(keys)):
        slots[_slot(keys, slots, keys[i])] = i + 1


@njit(cache=True, nogil=True)
def _block(index, x, y, z, make):  # type: ignore[no-untyped-def]
    """Number of the block of a voxel (x, y, z); -1 if there is none and it may not be made."""
    key = ((z >> 2) << 38) | ((y >> 2) << 19) | (x >> 2)
    slot = _slot(index.block_keys, index.block_slots, key)
    found = index.block_slots[slot]
    if found != 0:
        return np.int64(found - 1)
    if not make:
        return np.int64(-1)
    block = index.counts[0]
    index.counts[0] = block + 1
    index.block_keys[block] = key
    index.block_slots[slot] = block + 1
    key = ((z >> 5) << 32) | ((y >> 5) << 16) | (x >> 5)
    slot = _slot(index.region_keys, index.region_slots, key)
    region = index.region_slots[slot] - 1
    if region < 0:
        region = index.counts[1]
        index.counts[1] = region + 1
        index.region_keys[region] = key
        index.region_slots[slot] = region + 1
    index.block_next[block] = index.region_first[region]
    index.region_first[region] = block + 1
    return block


@njit(cache=True, nogil=True)
def enter(voxels, index, start, stop):  # type: ignore[no-untyped-def]
    """Enters the voxels from number ``start`` to ``stop`` in the index."""
    for i in range(start, stop):
        key = voxels[i].key
        x, y, z = key & MASK, (key >> BITS) & MASK, key >> (2 * BITS)
        index.block_voxels[_block(index, x, y, z, True), ((z & 3) << 4) | ((y & 3) << 2) | (x & 3)] = i + 1


@njit(cache=True, nogil=True)
def find(voxels, index, n, max_voxels, max_blocks, points, stamp, per_m, hits):  # type: ignore[no-untyped-def]
    """Numbers of the points' voxels in ``hits`` (-1: no place), new ones made; returns the number of voxels.

    Apart from ``add``, so that the processor waits for many voxels at once.
    """
    last_x, last_y, last_z, block = np.int64(-1), np.int64(-1), np.int64(-1), np.int64(0)
    for i in range(points.shape[0]):
        x = np.int64(np.floor(np.float64(points[i, 0]) * per_m)) + HALF
        y = np.int64(np.floor(np.float64(points[i, 1]) * per_m)) + HALF
        z = np.int64(np.floor(np.float64(points[i, 2]) * per_m)) + HALF
        hits[i] = -1
        if not (0 <= x <= MASK and 0 <= y <= MASK and 0 <= z <= MASK):
            continue
        if x >> 2 != last_x or y >> 2 != last_y or z >> 2 != last_z:
            block = _block(index, x, y, z, n < max_voxels and index.counts[0] < max_blocks)
            last_x, last_y, last_z = x >> 2, y >> 2, z >> 2
        if block < 0:
            continue
        cell = ((z & 3) << 4) | ((y & 3) << 2) | (x & 3)
        at = index.block_voxels[block, cell] - 1
        if at < 0:
            if n >= max_voxels:
                continue
            at = n
            n += 1
            index.block_voxels[block, cell] = at + 1
            voxel = voxels[at]
            voxel.key = (z << (2 * BITS)) | (y << BITS) | x
            voxel.weight = voxel.x = voxel.y = voxel.z = voxel.red = voxel.green = voxel.blue = voxel.sources = 0
            voxel.first_ns = voxel.last_ns = stamp
            voxel.through_ns = voxel.through_before_ns = NEVER
        hits[i] = at
    return n


@njit(cache=True, nogil=True)
def add(  # type: ignore[no-untyped-def]
    voxels, hits, points, colours, camera, stamp, per_m, near_var, far_var, carve_views, back
):
    """Adds points to their voxels; returns the number of points added and of voxels that are ``back``."""
    n_hits, n_back = 0, 0
    for i in range(points.shape[0]):
        if hits[i] < 0:
            continue
        n_hits += 1
        voxel = voxels[hits[i]]
        # who, when
        voxel.first_ns = min(voxel.first_ns, stamp)
        if stamp > voxel.last_ns:
            voxel.last_ns = stamp
            if voxel.through_ns != NEVER:
                was = _gone(voxel, carve_views)
                if voxel.through_ns <= stamp:
                    voxel.through_ns = voxel.through_before_ns = NEVER
                elif voxel.through_before_ns <= stamp:
                    voxel.through_before_ns = NEVER
                if was and not _gone(voxel, carve_views):
                    back[n_back] = hits[i]
                    n_back += 1
        # where, weighted by the inverse variance of depth
        px, py, pz = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        dx, dy, dz = px - camera[0], py - camera[1], pz - camera[2]
        squared = dx * dx + dy * dy + dz * dz
        weight = np.uint32(_MAX_WEIGHT * near_var / (near_var + far_var * squared * squared) + 0.5)
        weight = max(np.uint32(1), weight)
        if voxel.weight + weight <= _FULL:
            x, y, z = px * per_m, py * per_m, pz * per_m
            voxel.weight += weight
            voxel.x += weight * np.uint32((x - np.floor(x)) * 256.0)
            voxel.y += weight * np.uint32((y - np.floor(y)) * 256.0)
            voxel.z += weight * np.uint32((z - np.floor(z)) * 256.0)
            voxel.red += weight * np.uint32(colours[i, 0])
            voxel.green += weight * np.uint32(colours[i, 1])
            voxel.blue += weight * np.uint32(colours[i, 2])
    return n_hits, n_back


@njit(cache=True, nogil=True, inline="always")
def _gone(voxel, carve_views):  # type: ignore[no-untyped-def]
    if carve_views == 1:
        return voxel.through_ns != NEVER
    return carve_views == 2 and voxel.through_before_ns != NEVER


@njit(cache=True, nogil=True, inline="always")
def _pass_through(voxel, stamp, carve_views):  # type: ignore[no-untyped-def]
    """Notes that a view sees through a voxel; true if it is gone by that."""
    if stamp <= voxel.last_ns:
        return False
    was = _gone(voxel, carve_views)
    if stamp > voxel.through_ns:
        voxel.through_before_ns = voxel.through_ns
        voxel.through_ns = stamp
    elif stamp > voxel.through_before_ns:
        voxel.through_before_ns = stamp
    return not was and _gone(voxel, carve_views)


@njit(cache=True, nogil=True)
def recheck(voxels, numbers, camera, limit_m, stamp, voxel_m, carve_views, gone):  # type: ignore[no-untyped-def]
    """Notes which voxels a view sees through; writes those that are gone by it to ``gone`` and returns how many."""
    n = 0
    for i in range(len(numbers)):
        voxel = voxels[numbers[i]]
        key = voxel.key
        x = ((key & MASK) - HALF + 0.5) * voxel_m
        y = (((key >> BITS) & MASK) - HALF + 0.5) * voxel_m
        z = ((key >> (2 * BITS)) - HALF + 0.5) * voxel_m
        if sees_through(camera, limit_m, x, y, z) and _pass_through(voxel, stamp, carve_views):
            gone[n] = numbers[i]
            n += 1
    return n


@njit(cache=True, nogil=True)
def carve(voxels, index, camera, limit_m, far_m, stamp, voxel_m, carve_views, gone):  # type: ignore[no-untyped-def]
    """``recheck`` for every voxel, without asking those that the view can't see through."""
    n = 0
    low, high = _bounds_of(camera, limit_m)
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for k in range(3):
        first[k] = (np.int64(np.floor(low[k] / voxel_m)) + HALF) >> 5
        last[k] = (np.int64(np.floor(high[k] / voxel_m)) + HALF) >> 5
    asked = np.float64(last[0] - first[0] + 1) * (last[1] - first[1] + 1) * (last[2] - first[2] + 1)
    if asked > index.counts[1]:  # a wide view of a small map
        for region in range(index.counts[1]):
            n = _carve_region(voxels, index, region, camera, limit_m, far_m, stamp, voxel_m, carve_views, gone, n)
        return n
    for rz in range(first[2], last[2] + 1):
        for ry in range(first[1], last[1] + 1):
            for rx in range(first[0], last[0] + 1):
                slot = _slot(index.region_keys, index.region_slots, (rz << 32) | (ry << 16) | rx)
                region = index.region_slots[slot] - 1
                if region >= 0:
                    n = _carve_region(
                        voxels, index, region, camera, limit_m, far_m, stamp, voxel_m, carve_views, gone, n
                    )
    return n


@njit(cache=True, nogil=True)
def _carve_region(  # type: ignore[no-untyped-def]
    voxels, index, region, camera, limit_m, far_m, stamp, voxel_m, carve_views, gone, n
):
    key = index.region_keys[region]
    rx, ry, rz = key & 0xFFFF, (key >> 16) & 0xFFFF, key >> 32
    x, y, z = _middle(rx, 32 * voxel_m, 5), _middle(ry, 32 * voxel_m, 5), _middle(rz, 32 * voxel_m, 5)
    if not may_see_through(camera, far_m, x, y, z, 15.5 * voxel_m):
        return n
    block = index.region_first[region]
    while block != 0:
        key = index.block_keys[block - 1]
        bx, by, bz = key & 0x7FFFF, (key >> 19) & 0x7FFFF, key >> 38
        x, y, z = _middle(bx, 4 * voxel_m, 2), _middle(by, 4 * voxel_m, 2), _middle(bz, 4 * voxel_m, 2)
        if may_see_through(camera, far_m, x, y, z, 1.5 * voxel_m):
            for cell in range(64):
                at = index.block_voxels[block - 1, cell] - 1
                if at < 0:
                    continue
                x = (((bx << 2) | (cell & 3)) - HALF + 0.5) * voxel_m
                y = (((by << 2) | ((cell >> 2) & 3)) - HALF + 0.5) * voxel_m
                z = (((bz << 2) | (cell >> 4)) - HALF + 0.5) * voxel_m
                if sees_through(camera, limit_m, x, y, z) and _pass_through(voxels[at], stamp, carve_views):
                    gone[n] = at
                    n += 1
        block = index.block_next[block - 1]
    return n


@njit(cache=True, nogil=True, inline="always")
def _middle(i, size_m, bits):  # type: ignore[no-untyped-def]
    return (i - (HALF >> bits) + 0.5) * size_m


@njit(cache=True, nogil=True)
def _bounds_of(c, limit_m):  # type: ignore[no-untyped-def]
    """The box [m, world] around a camera and the corners of its picture at the farthest limit."""
    low, high = np.empty(3), np.empty(3)
    for k in range(3):  # the camera's place: -R^T t
        low[k] = high[k] = -(c[k] * c[3] + c[4 + k] * c[7] + c[8 + k] * c[11])
    place = low.copy()
    for corner in range(4):
        x = ((corner & 1) * limit_m.shape[1] * c[16] - c[14]) / c[12] * c[18]
        y = ((corner >> 1) * limit_m.shape[0] * c[16] - c[15]) / c[13] * c[18]
        for k in range(3):
            at = place[k] + c[k] * x + c[4 + k] * y + c[8 + k] * c[18]
            low[k], high[k] = min(low[k], at), max(high[k], at)
    return low, high


@njit(cache=True, nogil=True)
def sets_of(voxels, hits, joined):  # type: ignore[no-untyped-def]
    """The different sets of sources of voxels; ``joined`` is -1 everywhere before, and -2 at these after."""
    found = np.empty(min(len(hits), len(joined)), np.int64)
    n = 0
    for i in range(len(hits)):
        if hits[i] < 0:
            continue
        number = voxels[hits[i]].sources
        if joined[number] == -1:
            joined[number] = -2
            found[n] = number
            n += 1
    return found[:n].copy()


@njit(cache=True, nogil=True)
def set_sources(voxels, hits, joined):  # type: ignore[no-untyped-def]
    """Gives the voxels hit the set of sources that ``joined`` says for theirs."""
    for i in range(len(hits)):
        if hits[i] < 0:
            continue
        voxel = voxels[hits[i]]
        voxel.sources = joined[voxel.sources]


@njit(cache=True, nogil=True)
def means(voxels, voxel_m, carve_views, out):  # type: ignore[no-untyped-def]
    """Writes mean position [m, world] and colour 0-1 of the voxels that are there to ``out`` (N, 6)."""
    n = 0
    for i in range(len(voxels)):
        voxel = voxels[i]
        if _gone(voxel, carve_views):
            continue
        key, weight = voxel.key, np.float64(voxel.weight)
        out[n, 0] = ((key & MASK) - HALF + (voxel.x / weight + 0.5) / 256.0) * voxel_m
        out[n, 1] = (((key >> BITS) & MASK) - HALF + (voxel.y / weight + 0.5) / 256.0) * voxel_m
        out[n, 2] = ((key >> (2 * BITS)) - HALF + (voxel.z / weight + 0.5) / 256.0) * voxel_m
        out[n, 3] = voxel.red / (255.0 * weight)
        out[n, 4] = voxel.green / (255.0 * weight)
        out[n, 5] = voxel.blue / (255.0 * weight)
        n += 1


@njit(cache=True, nogil=True, inline="always")
def sees_through(c, limit_m, x, y, z):  # type: ignore[no-untyped-def]
    """Does a view with camera ``c`` and limits (``FreeDepthImage``) see through a voxel with this centre [m, world]?"""
    depth = c[8] * x + c[9] * y + c[10] * z + c[11]
    if depth < c[17] or depth >= c[18]:
        return False
    u = c[12] * (c[0] * x + c[1] * y + c[2] * z + c[3]) / depth + c[14]
    v = c[13] * (c[4] * x + c[5] * y + c[6] * z + c[7]) / depth + c[15]
    col, row = int(np.floor((u + 0.5) / c[16])), int(np.floor((v + 0.5) / c[16]))
    if row < 0 or col < 0 or row >= limit_m.shape[0] or col >= limit_m.shape[1]:
        return False
    return depth < limit_m[row, col]


@njit(cache=True, nogil=True, inline="always")
def may_see_through(c, far_m, x, y, z, half):  # type: ignore[no-untyped-def]
    """False only if the view sees through nothing within a cube with this centre and half its side ``half`` [m]."""
    depth = c[8] * x + c[9] * y + c[10] * z + c[11]
    deep = half * (abs(c[8]) + abs(c[9]) + abs(c[10]))
    nearest = depth - deep
    if depth + deep < c[17] or nearest >= c[18]:
        return False
    if nearest <= 0.1:
        return True
    # the cube's picture reaches no farther than this from that of its centre
    x_c, y_c = c[0] * x + c[1] * y + c[2] * z + c[3], c[4] * x + c[5] * y + c[6] * z + c[7]
    u, v = c[12] * x_c / depth + c[14], c[13] * y_c / depth + c[15]
    reach_u = c[12] * (half * (abs(c[0]) + abs(c[1]) + abs(c[2])) + deep * abs(x_c) / depth) / nearest + 1.0
    reach_v = c[13] * (half * (abs(c[4]) + abs(c[5]) + abs(c[6])) + deep * abs(y_c) / depth) / nearest + 1.0
    cell = FAR_CELLS * c[16]
    rows, cols = far_m.shape
    if u + reach_u < 0.0 or v + reach_v < 0.0 or u - reach_u > cols * cell or v - reach_v > rows * cell:
        return False
    if max(reach_u, reach_v) > cell:
        return True  # near and large: more than the coarse cells around it would have to be asked
    row, col = int(np.floor((v + 0.5) / cell)), int(np.floor((u + 0.5) / cell))
    row, col = min(max(row, 0), rows - 1), min(max(col, 0), cols - 1)
    return nearest < far_m[row, col]
