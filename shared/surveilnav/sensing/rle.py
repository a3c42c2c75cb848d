"""Masks as run lengths, in COCO's uncompressed format (Lin et al. 2014).

The cells of a mask are read column by column, from top to bottom. Runs outside and inside the mask alternate; the first is
outside, and may be 0. The runs sum up to the number of cells.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import WireError


def encode(mask: NDArray[np.bool_]) -> list[int]:
    """The run lengths of a mask (height, width) bool of at least one cell."""
    if mask.ndim != 2 or mask.size == 0:
        raise ValueError(f"a mask is (height, width) of at least one cell, got {mask.shape}")
    cells = mask.ravel(order="F").astype(np.bool_, copy=False)
    starts = np.flatnonzero(cells[1:] != cells[:-1]) + 1
    runs: list[int] = np.diff(np.concatenate(([0], starts, [cells.size]))).tolist()
    return [0, *runs] if cells[0] else runs


def decode(runs: Sequence[int], width_px: int, height_px: int) -> NDArray[np.bool_]:
    """The mask (height, width) bool.

    Raises:
        WireError: a run other than the first is empty, or the runs don't sum up to the number of cells.
    """
    n_cells = width_px * height_px
    if not 1 <= len(runs) <= n_cells + 1:
        raise WireError(f"a mask of {width_px}x{height_px} has 1 to {n_cells + 1} runs, got {len(runs)}")
    if runs[0] < 0 or min(runs[1:], default=1) < 1:
        raise WireError("a mask's runs are of 1 cell at least; only the first may be 0")
    if sum(runs) != n_cells:
        raise WireError(f"a mask of {width_px}x{height_px} has {n_cells} cells, its runs have {sum(runs)}")
    inside = np.arange(len(runs)) % 2 == 1
    cells = np.repeat(inside, np.array(runs, dtype=np.int64))
    return cells.reshape(height_px, width_px, order="F")
