"""Refines a coarse mask by depth: joint bilateral upsampling (Kopf, Cohen, Lischinski, Uyttendaele 2007).

The logit of a pixel is a weighted mean of the coarse cells around it, in which cells at the pixel's own depth count most. The
mask's edge follows the jumps of depth that way, although a coarse cell is eight pixels wide.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

#: Standard deviation of the weight over the difference in log depth.
_SIGMA_LOG_DEPTH = 0.03
#: Offsets of the cells around a pixel, and standard deviation of their weight over the distance [cells].
_OFFSETS, _SIGMA_CELLS = (-1, 0, 1, 2), 0.7
#: Unknown depth is treated as this distance, which is unlike all others.
_UNKNOWN_M = 100.0
#: Larger windows are computed on a coarser grid, and enlarged.
_MAX_PIXELS = 12_000


def guided_mask(
    logits: Floats, depth_m: Floats, cells: tuple[int, int, int, int], cells_per_pixel: float
) -> NDArray[np.bool_]:
    """The mask (y1 - y0, x1 - x0) of a window of a picture.

    Args:
        logits: (h, w) coarse logits of the whole picture, positive inside the mask. The corners of cell (0, 0) and of the
            picture coincide.
        depth_m: (H, W) depth of the picture [m], 0 where there is none.
        cells: the window (x0, y0, x1, y1) [pixels].
        cells_per_pixel: size of a pixel in coarse cells.
    """
    x0, y0, x1, y1 = cells
    step = max(1, int(np.ceil(np.sqrt((y1 - y0) * (x1 - x0) / _MAX_PIXELS))))
    rows, columns = np.arange(y0, y1, step), np.arange(x0, x1, step)
    fine = _log_depth(depth_m[np.ix_(rows, columns)])
    (i, dy), (j, dx) = (_place(at, cells_per_pixel) for at in (rows, columns))
    total, weights = np.zeros(fine.shape, np.float32), np.full(fine.shape, 1e-12, np.float32)
    h, w = logits.shape
    middles = [
        np.clip(np.round((np.arange(n) + 0.5) / cells_per_pixel - 0.5).astype(int), 0, side - 1)
        for n, side in ((h, depth_m.shape[0]), (w, depth_m.shape[1]))
    ]
    coarse = _log_depth(depth_m[np.ix_(*middles)])
    beside = [(np.clip(j + right, 0, w - 1), _nearness(right - dx)) for right in _OFFSETS]
    for down in _OFFSETS:
        r, near_y = np.clip(i + down, 0, h - 1), _nearness(down - dy)
        for c, near_x in beside:
            at = np.ix_(r, c)
            off = (fine - coarse[at]) / np.float32(_SIGMA_LOG_DEPTH)
            # the small constant lets the nearest cells decide where none is at the pixel's depth
            weight = near_y[:, None] * near_x[None, :] * (np.exp(-0.5 * off * off) + np.float32(1e-6))
            total += weight * logits[at]
            weights += weight
    mask = (total / weights > 0).astype(np.uint8)
    if step > 1:
        mask = cv2.resize(mask, (x1 - x0, y1 - y0), interpolation=cv2.INTER_NEAREST)
    return np.asarray(mask > 0)


def _log_depth(depth_m: Floats) -> Floats:
    return np.asarray(np.log(np.where(depth_m > 0, np.maximum(depth_m, 0.1), _UNKNOWN_M)), np.float32)


def _place(pixels: NDArray[np.int64], cells_per_pixel: float) -> tuple[NDArray[np.int64], Floats]:
    """For each pixel, the last cell whose centre isn't after the pixel's centre, and the distance between the two [cells]."""
    at = (pixels + 0.5) * cells_per_pixel - 0.5
    before = np.floor(at)
    return before.astype(np.int64), (at - before).astype(np.float32)


def _nearness(cells: Floats) -> Floats:
    return np.asarray(np.exp(-0.5 * (cells / _SIGMA_CELLS) ** 2), np.float32)
