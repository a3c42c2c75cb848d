"""What segmenters that are told boxes share: a picture of the right size, and masks cut to their boxes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from surveilnav.sensing.views import box_cells

#: Of each box of a picture the mask of its cells (``box_cells``); None: the whole box.
Masks = list[NDArray[np.bool_] | None]

#: Means and deviations of ImageNet's colours, on the scale 0-1: the networks were trained so.
_MEAN, _STD = np.array([0.485, 0.456, 0.406], np.float32), np.array([0.229, 0.224, 0.225], np.float32)


def pixels(rgb: NDArray[np.uint8], width_px: int, height_px: int) -> NDArray[np.float32]:
    """(3, ``height_px``, ``width_px``) float32: the picture resized and normalised."""
    resized = np.asarray(Image.fromarray(rgb).resize((width_px, height_px), Image.Resampling.BILINEAR), np.float32)
    return np.ascontiguousarray(((resized / 255.0 - _MEAN) / _STD).transpose(2, 0, 1))


def in_box(mask: NDArray[np.bool_], xyxy: NDArray[np.float32]) -> NDArray[np.bool_] | None:
    """Of a mask (height, width) of a picture the box's cells; None where it marks none of them: the whole box."""
    height, width = mask.shape
    x0, y0, x1, y1 = (float(v) for v in xyxy)
    left, top, right, bottom = box_cells((x0, y0, x1, y1), width, height)
    inside = mask[top:bottom, left:right]
    return np.ascontiguousarray(inside) if inside.any() else None
