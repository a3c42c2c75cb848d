"""Which pixels of a view show the floor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: What is within this height is floor: rugs, thresholds.
FLOOR_WITHIN_M = 0.03


def floor_mask(
    depth_m: NDArray[np.floating], reference_m: NDArray[np.float32], is_floor: NDArray[np.bool_], height_m: float
) -> NDArray[np.bool_]:
    """Where a view shows the floor: points within ``FLOOR_WITHIN_M`` of it. All (H, W), as in ``Reference``."""
    near: NDArray[np.bool_] = np.abs(depth_m / reference_m - 1.0) * height_m <= FLOOR_WITHIN_M
    return is_floor & near
