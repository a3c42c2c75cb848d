"""A coarse mask made fine by depth: joint bilateral upsampling (Kopf, Cohen, Lischinski, Uyttendaele 2007).

A pixel takes its logit from the coarse cells around it, above all from those at its own distance. So a mask ends where depth
jumps, though its cells are eight pixels wide.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

#: Cells whose log of depth differs by this count e^-1/2 as much.
_LOG_DEPTH = 0.03
#: The cells around a pixel, and how fast they count less with distance [cells].
_AROUND, _SIGMA_CELLS = (-1, 0, 1, 2), 0.7
#: Depth that isn't known, as a distance of its own.
_UNKNOWN_M = 100.0
#: No pixel is worth more work: a larger window is looked at on a coarser grid.
_MOST_PIXELS = 12_000


def guided_mask(
    logits: Floats, depth_m: Floats, cells: tuple[int, int, int, int], cells_per_pixel: float
) -> NDArray[np.bool_]:
    """(y1 - y0, x1 - x0) the mask of a window of a picture.

    Args:
        logits: (h, w) coarse, of the whole picture; above 0: the mask. Cell (0, 0) begins where the picture begins.
        depth_m: (H, W) of the picture [m], 0: none.
        cells: (x0, y0, x1, y1) the window [pixels].
        cells_per_pixel: coarse cells a pixel.
    """
    x0, y0, x1, y1 = cells
    step = max(1, int(np.ceil(np.sqrt((y1 - y0) * (x1 - x0) / _MOST_PIXELS))))
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
    beside = [(np.clip(j + right, 0, w - 1), _nearness(right - dx)) for right in _AROUND]
    for down in _AROUND:
        r, near_y = np.clip(i + down, 0, h - 1), _nearness(down - dy)
        for c, near_x in beside:
            at = np.ix_(r, c)
            off = (fine - coarse[at]) / np.float32(_LOG_DEPTH)
            # next to nothing, but not nothing: where no cell is at its distance, the nearest speak
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
    """(the cell at or before the middle of each pixel, how far after that cell's middle it lies [cells])."""
    at = (pixels + 0.5) * cells_per_pixel - 0.5
    before = np.floor(at)
    return before.astype(np.int64), (at - before).astype(np.float32)


def _nearness(cells: Floats) -> Floats:
    return np.asarray(np.exp(-0.5 * (cells / _SIGMA_CELLS) ** 2), np.float32)
