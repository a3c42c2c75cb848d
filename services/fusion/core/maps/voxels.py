"""The compiled inner loops of the point cloud: finding voxels, adding points to them, and carving by what views see through.

They are in one file, since Numba keeps a compiled function only until the file of that function changes: a change in a
helper that is compiled into it wouldn't be noticed in another file.
"""

from __future__ import annotations

import numpy as np
from numba import njit

BITS = 21  # per axis: +-26 km at 2.5 cm
HALF = 1 << (BITS - 1)
MASK = (1 << BITS) - 1
NEVER = -(1 << 63)

#: A voxel. ``weight`` is the sum of its points' weights; ``x``, ``y``, ``z`` are sums of their weighted offsets within the cube
#: (0-255), ``red``, ``green``, ``blue`` of their weighted colours. All are integers, so that the order of views doesn't matter.
#: ``sources`` is the number of its set of sources, ``first_ns`` and ``last_ns`` the stamps of its first and last point.
#: ``seen_through_ns`` and ``seen_through_before_ns`` are the stamps of the two newest views that see through it, of those newer
#: than its last point (``NEVER``: there is none).
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
        ("seen_through_ns", np.int64),
        ("seen_through_before_ns", np.int64),
    ]
)
_MAX_POINT_WEIGHT = 64
_MAX_VOXEL_WEIGHT = 16_800_000  # from which a voxel's mean no longer changes; 255 times this fits 32 bits
COARSE_CELLS = 2  # side of a coarse cell, in cells (carving.FreeDepthImage)


@njit(cache=True, nogil=True, inline="always")
def _find_slot(keys, slots, key):  # type: ignore[no-untyped-def]
    """The slot of a key in a hash table, or the empty slot where it would go (linear probing)."""
    mask = np.int64(len(slots) - 1)
    h = key * np.int64(-7046029254386353131)  # 2^64 / golden ratio
    slot = (h ^ (h >> 29)) & mask
    while slots[slot] != 0 and keys[slots[slot] - 1] != key:
        slot = (slot + 1) & mask
    return slot


@njit(cache=True, nogil=True)
def fill_slots(keys, slots):  # type: ignore[no-untyped-def]
    """Enters all keys in an empty hash table."""
    for i in range(len(keys)):
        slots[_find_slot(keys, slots, keys[i])] = i + 1


@njit(cache=True, nogil=True)
def _find_block(index, x, y, z, create):  # type: ignore[no-untyped-def]
    """The number of the block that contains a voxel (x, y, z); -1 if there is none and ``create`` is false."""
    key = ((z >> 2) << 38) | ((y >> 2) << 19) | (x >> 2)
    slot = _find_slot(index.block_keys, index.block_slots, key)
    found = index.block_slots[slot]
    if found != 0:
        return np.int64(found - 1)
    if not create:
        return np.int64(-1)
    block = index.counts[0]
    index.counts[0] = block + 1
    index.block_keys[block] = key
    index.block_slots[slot] = block + 1
    key = ((z >> 5) << 32) | ((y >> 5) << 16) | (x >> 5)
    slot = _find_slot(index.region_keys, index.region_slots, key)
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
def index_voxels(voxels, index, start, stop):  # type: ignore[no-untyped-def]
    """Adds the voxels with numbers from ``start`` to ``stop`` to the index."""
    for i in range(start, stop):
        key = voxels[i].key
        x, y, z = key & MASK, (key >> BITS) & MASK, key >> (2 * BITS)
        index.block_voxels[_find_block(index, x, y, z, True), ((z & 3) << 4) | ((y & 3) << 2) | (x & 3)] = i + 1


@njit(cache=True, nogil=True)
def find_or_create(voxels, index, n, max_voxels, max_blocks, points, stamp, per_m, hits):  # type: ignore[no-untyped-def]
    """Writes the numbers of the voxels of points (N, 3) [m, world] into ``hits`` (N,), -1 for a point without a place.

    Voxels that don't exist yet are created. This is a pass of its own, before ``add_points``, so that the processor can
    fetch many voxels from memory at the same time.

    Returns:
        The number of voxels.
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
            block = _find_block(index, x, y, z, n < max_voxels and index.counts[0] < max_blocks)
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
            voxel.seen_through_ns = voxel.seen_through_before_ns = NEVER
        hits[i] = at
    return n


@njit(cache=True, nogil=True)
def add_points(  # type: ignore[no-untyped-def]
    voxels, hits, points, colours, camera, stamp, per_m, near_var, far_var, carve_views, restored
):
    """Adds points (N, 3) [m, world] to the voxels ``hits`` (N,).

    A carved voxel that is restored by a newer point is written to ``restored``.

    Returns:
        The number of points added, and the number of voxels restored.
    """
    n_hits, n_restored = 0, 0
    for i in range(points.shape[0]):
        if hits[i] < 0:
            continue
        n_hits += 1
        voxel = voxels[hits[i]]
        # when it was seen
        voxel.first_ns = min(voxel.first_ns, stamp)
        if stamp > voxel.last_ns:
            voxel.last_ns = stamp
            if voxel.seen_through_ns != NEVER:
                was_carved = _is_carved(voxel, carve_views)
                if voxel.seen_through_ns <= stamp:
                    voxel.seen_through_ns = voxel.seen_through_before_ns = NEVER
                elif voxel.seen_through_before_ns <= stamp:
                    voxel.seen_through_before_ns = NEVER
                if was_carved and not _is_carved(voxel, carve_views):
                    restored[n_restored] = hits[i]
                    n_restored += 1
        # where it is, weighted by the inverse variance of depth
        px, py, pz = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        dx, dy, dz = px - camera[0], py - camera[1], pz - camera[2]
        squared = dx * dx + dy * dy + dz * dz
        weight = np.uint32(_MAX_POINT_WEIGHT * near_var / (near_var + far_var * squared * squared) + 0.5)
        weight = max(np.uint32(1), weight)
        if voxel.weight + weight <= _MAX_VOXEL_WEIGHT:
            x, y, z = px * per_m, py * per_m, pz * per_m
            voxel.weight += weight
            voxel.x += weight * np.uint32((x - np.floor(x)) * 256.0)
            voxel.y += weight * np.uint32((y - np.floor(y)) * 256.0)
            voxel.z += weight * np.uint32((z - np.floor(z)) * 256.0)
            voxel.red += weight * np.uint32(colours[i, 0])
            voxel.green += weight * np.uint32(colours[i, 1])
            voxel.blue += weight * np.uint32(colours[i, 2])
    return n_hits, n_restored


@njit(cache=True, nogil=True, inline="always")
def _is_carved(voxel, carve_views):  # type: ignore[no-untyped-def]
    if carve_views == 1:
        return voxel.seen_through_ns != NEVER
    return carve_views == 2 and voxel.seen_through_before_ns != NEVER


@njit(cache=True, nogil=True, inline="always")
def _record_seen_through(voxel, stamp, carve_views):  # type: ignore[no-untyped-def]
    """Records that a view sees through a voxel; true if the voxel is carved away by that."""
    if stamp <= voxel.last_ns:
        return False
    was_carved = _is_carved(voxel, carve_views)
    if stamp > voxel.seen_through_ns:
        voxel.seen_through_before_ns = voxel.seen_through_ns
        voxel.seen_through_ns = stamp
    elif stamp > voxel.seen_through_before_ns:
        voxel.seen_through_before_ns = stamp
    return not was_carved and _is_carved(voxel, carve_views)


@njit(cache=True, nogil=True)
def carve_listed(voxels, numbers, camera, free_depth_m, stamp, voxel_m, carve_views, carved):  # type: ignore[no-untyped-def]
    """Carves the listed voxels by what a view sees through.

    Writes the numbers of those that are carved away by it to ``carved`` and returns how many there are.
    """
    n = 0
    for i in range(len(numbers)):
        voxel = voxels[numbers[i]]
        key = voxel.key
        x = ((key & MASK) - HALF + 0.5) * voxel_m
        y = (((key >> BITS) & MASK) - HALF + 0.5) * voxel_m
        z = ((key >> (2 * BITS)) - HALF + 0.5) * voxel_m
        if sees_through(camera, free_depth_m, x, y, z) and _record_seen_through(voxel, stamp, carve_views):
            carved[n] = numbers[i]
            n += 1
    return n


@njit(cache=True, nogil=True)
def carve(voxels, index, camera, free_depth_m, coarse_max_m, stamp, voxel_m, carve_views, carved):  # type: ignore[no-untyped-def]
    """``carve_listed`` for all voxels; regions and blocks that the view can't see through are skipped as a whole."""
    n = 0
    low, high = _frustum_bounds(camera, free_depth_m)
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for k in range(3):
        first[k] = (np.int64(np.floor(low[k] / voxel_m)) + HALF) >> 5
        last[k] = (np.int64(np.floor(high[k] / voxel_m)) + HALF) >> 5
    n_regions = np.float64(last[0] - first[0] + 1) * (last[1] - first[1] + 1) * (last[2] - first[2] + 1)
    if n_regions > index.counts[1]:  # a wide view of a small map: all regions there are
        for region in range(index.counts[1]):
            n = _carve_region(
                voxels, index, region, camera, free_depth_m, coarse_max_m, stamp, voxel_m, carve_views, carved, n
            )
        return n
    for rz in range(first[2], last[2] + 1):
        for ry in range(first[1], last[1] + 1):
            for rx in range(first[0], last[0] + 1):
                slot = _find_slot(index.region_keys, index.region_slots, (rz << 32) | (ry << 16) | rx)
                region = index.region_slots[slot] - 1
                if region >= 0:
                    n = _carve_region(
                        voxels,
                        index,
                        region,
                        camera,
                        free_depth_m,
                        coarse_max_m,
                        stamp,
                        voxel_m,
                        carve_views,
                        carved,
                        n,
                    )
    return n


@njit(cache=True, nogil=True)
def _carve_region(  # type: ignore[no-untyped-def]
    voxels, index, region, camera, free_depth_m, coarse_max_m, stamp, voxel_m, carve_views, carved, n
):
    key = index.region_keys[region]
    rx, ry, rz = key & 0xFFFF, (key >> 16) & 0xFFFF, key >> 32
    x, y, z = _centre(rx, 32 * voxel_m, 5), _centre(ry, 32 * voxel_m, 5), _centre(rz, 32 * voxel_m, 5)
    if not may_see_through(camera, coarse_max_m, x, y, z, 15.5 * voxel_m):
        return n
    block = index.region_first[region]
    while block != 0:
        key = index.block_keys[block - 1]
        bx, by, bz = key & 0x7FFFF, (key >> 19) & 0x7FFFF, key >> 38
        x, y, z = _centre(bx, 4 * voxel_m, 2), _centre(by, 4 * voxel_m, 2), _centre(bz, 4 * voxel_m, 2)
        if may_see_through(camera, coarse_max_m, x, y, z, 1.5 * voxel_m):
            for cell in range(64):
                at = index.block_voxels[block - 1, cell] - 1
                if at < 0:
                    continue
                x = (((bx << 2) | (cell & 3)) - HALF + 0.5) * voxel_m
                y = (((by << 2) | ((cell >> 2) & 3)) - HALF + 0.5) * voxel_m
                z = (((bz << 2) | (cell >> 4)) - HALF + 0.5) * voxel_m
                if sees_through(camera, free_depth_m, x, y, z) and _record_seen_through(voxels[at], stamp, carve_views):
                    carved[n] = at
                    n += 1
        block = index.block_next[block - 1]
    return n


@njit(cache=True, nogil=True, inline="always")
def _centre(i, size_m, bits):  # type: ignore[no-untyped-def]
    return (i - (HALF >> bits) + 0.5) * size_m


@njit(cache=True, nogil=True)
def _frustum_bounds(c, free_depth_m):  # type: ignore[no-untyped-def]
    """The corners (3,), (3,) [m, world] of the box around a camera and the corners of its picture at the largest free depth."""
    low, high = np.empty(3), np.empty(3)
    for k in range(3):  # the camera's position: -R^T t
        low[k] = high[k] = -(c[k] * c[3] + c[4 + k] * c[7] + c[8 + k] * c[11])
    position = low.copy()
    for corner in range(4):
        x = ((corner & 1) * free_depth_m.shape[1] * c[16] - c[14]) / c[12] * c[18]
        y = ((corner >> 1) * free_depth_m.shape[0] * c[16] - c[15]) / c[13] * c[18]
        for k in range(3):
            at = position[k] + c[k] * x + c[4 + k] * y + c[8 + k] * c[18]
            low[k], high[k] = min(low[k], at), max(high[k], at)
    return low, high


@njit(cache=True, nogil=True)
def source_sets_of(voxels, hits, set_with_source):  # type: ignore[no-untyped-def]
    """The numbers of the different source sets that the voxels ``hits`` have.

    ``set_with_source`` must be -1 everywhere before; after it, the entries of these sets are -2.
    """
    found = np.empty(min(len(hits), len(set_with_source)), np.int64)
    n = 0
    for i in range(len(hits)):
        if hits[i] < 0:
            continue
        number = voxels[hits[i]].sources
        if set_with_source[number] == -1:
            set_with_source[number] = -2
            found[n] = number
            n += 1
    return found[:n].copy()


@njit(cache=True, nogil=True)
def replace_source_sets(voxels, hits, set_with_source):  # type: ignore[no-untyped-def]
    """Replaces the source set ``k`` of each of the voxels ``hits`` by ``set_with_source[k]``."""
    for i in range(len(hits)):
        if hits[i] < 0:
            continue
        voxel = voxels[hits[i]]
        voxel.sources = set_with_source[voxel.sources]


@njit(cache=True, nogil=True)
def write_means(voxels, voxel_m, carve_views, out):  # type: ignore[no-untyped-def]
    """Writes the mean positions [m, world] and colours (0-1) of the voxels that aren't carved to ``out`` (N, 6)."""
    n = 0
    for i in range(len(voxels)):
        voxel = voxels[i]
        if _is_carved(voxel, carve_views):
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
def sees_through(c, free_depth_m, x, y, z):  # type: ignore[no-untyped-def]
    """Whether a view sees through a voxel with this centre [m, world]. ``c``: ``FreeDepthImage.camera``."""
    depth = c[8] * x + c[9] * y + c[10] * z + c[11]
    if depth < c[17] or depth >= c[18]:
        return False
    u = c[12] * (c[0] * x + c[1] * y + c[2] * z + c[3]) / depth + c[14]
    v = c[13] * (c[4] * x + c[5] * y + c[6] * z + c[7]) / depth + c[15]
    col, row = int(np.floor((u + 0.5) / c[16])), int(np.floor((v + 0.5) / c[16]))
    if row < 0 or col < 0 or row >= free_depth_m.shape[0] or col >= free_depth_m.shape[1]:
        return False
    return depth < free_depth_m[row, col]


@njit(cache=True, nogil=True, inline="always")
def may_see_through(c, coarse_max_m, x, y, z, half):  # type: ignore[no-untyped-def]
    """False only if a view sees through nothing in the cube with this centre and half side ``half`` [m]: a fast rejection."""
    depth = c[8] * x + c[9] * y + c[10] * z + c[11]
    half_depth = half * (abs(c[8]) + abs(c[9]) + abs(c[10]))
    nearest = depth - half_depth
    if depth + half_depth < c[17] or nearest >= c[18]:
        return False
    if nearest <= 0.1:
        return True
    # in the picture, the cube extends no farther than this from its centre
    x_c, y_c = c[0] * x + c[1] * y + c[2] * z + c[3], c[4] * x + c[5] * y + c[6] * z + c[7]
    u, v = c[12] * x_c / depth + c[14], c[13] * y_c / depth + c[15]
    reach_u = c[12] * (half * (abs(c[0]) + abs(c[1]) + abs(c[2])) + half_depth * abs(x_c) / depth) / nearest + 1.0
    reach_v = c[13] * (half * (abs(c[4]) + abs(c[5]) + abs(c[6])) + half_depth * abs(y_c) / depth) / nearest + 1.0
    cell = COARSE_CELLS * c[16]
    rows, cols = coarse_max_m.shape
    if u + reach_u < 0.0 or v + reach_v < 0.0 or u - reach_u > cols * cell or v - reach_v > rows * cell:
        return False
    if max(reach_u, reach_v) > cell:
        return True  # so near and large that its picture covers more than the neighbouring coarse cells
    row, col = int(np.floor((v + 0.5) / cell)), int(np.floor((u + 0.5) / cell))
    row, col = min(max(row, 0), rows - 1), min(max(col, 0), cols - 1)
    return nearest < coarse_max_m[row, col]
