"""What segmenters with box prompts share: the normalised input picture, and masks cropped to their boxes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from surveilnav.sensing.views import box_cells

#: For each box of a picture, the mask of its cells (``box_cells``); None: the whole box.
Masks = list[NDArray[np.bool_] | None]

#: Means and standard deviations of ImageNet's colours on the scale 0-1, with which the networks were trained.
_MEAN, _STD = np.array([0.485, 0.456, 0.406], np.float32), np.array([0.229, 0.224, 0.225], np.float32)


def normalized_pixels(rgb: NDArray[np.uint8], width_px: int, height_px: int) -> NDArray[np.float32]:
    """(3, ``height_px``, ``width_px``) float32, the resized and normalised picture."""
    resized = np.asarray(Image.fromarray(rgb).resize((width_px, height_px), Image.Resampling.BILINEAR), np.float32)
    return np.ascontiguousarray(((resized / 255.0 - _MEAN) / _STD).transpose(2, 0, 1))


def crop_to_box(mask: NDArray[np.bool_], xyxy: NDArray[np.float32]) -> NDArray[np.bool_] | None:
    """Crops a mask (height, width) of a picture to the cells of a box; None (the whole box) if it marks none of them."""
    height, width = mask.shape
    x0, y0, x1, y1 = (float(v) for v in xyxy)
    left, top, right, bottom = box_cells((x0, y0, x1, y1), width, height)
    inside = mask[top:bottom, left:right]
    return np.ascontiguousarray(inside) if inside.any() else None
