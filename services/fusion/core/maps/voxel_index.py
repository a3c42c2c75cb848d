"""The arrays of the spatial hash of the voxels, which ``voxels.py`` fills and searches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.fusion.core.maps.voxels import fill_slots


class Index(NamedTuple):
    """Spatial hash of the voxels: blocks of 4x4x4 voxels, and regions of 8x8x8 blocks.

    All numbers of voxels, blocks and regions in it are stored plus one, so that 0 means none.
    """

    counts: NDArray[np.int64]  # number of blocks, number of regions
    block_keys: NDArray[np.int64]
    block_voxels: NDArray[np.int32]  # (n, 64): the voxels of each block
    block_next: NDArray[np.int32]  # linked list: the next block of the same region
    block_slots: NDArray[np.int32]  # hash table of the blocks
    region_keys: NDArray[np.int64]
    region_first: NDArray[np.int32]  # the first block of each region
    region_slots: NDArray[np.int32]  # hash table of the regions


def new_index(n_blocks: int) -> Index:
    """An empty index with room for ``n_blocks``."""
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


def grow_index(index: Index, n_blocks: int) -> Index:
    """A copy of an index with room for ``n_blocks``."""
    larger = new_index(n_blocks)
    larger.counts[:] = index.counts
    blocks, regions = index.counts
    larger.block_keys[:blocks] = index.block_keys[:blocks]
    larger.block_voxels[:blocks] = index.block_voxels[:blocks]
    larger.block_next[:blocks] = index.block_next[:blocks]
    larger.region_keys[:regions] = index.region_keys[:regions]
    larger.region_first[:regions] = index.region_first[:regions]
    fill_slots(larger.block_keys[:blocks], larger.block_slots)
    fill_slots(larger.region_keys[:regions], larger.region_slots)
    return larger
