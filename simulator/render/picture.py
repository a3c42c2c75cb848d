"""A rendered picture: what the renderer makes and the view cache keeps. Apart from both, so that a camera whose views
are all cached loads neither renderer nor ray caster.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Lighting = Literal["baked", "shadowed", "flat"]

#: Grows when pictures change; caches of pictures depend on it.
PICTURES_VERSION = 2


@dataclass(frozen=True, slots=True, eq=False)
class Rendered:
    """One picture.

    Attributes:
        rgb: (H, W, 3) uint8 sRGB.
        depth_m: (H, W) float32 [m] along the optical axis, 0 where nothing is in range.
        instance_ids: (H, W) uint16, whatever the range; 0: nothing.
    """

    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    instance_ids: NDArray[np.uint16]


def within(depth_m: NDArray[np.float32], depth_range_m: tuple[float, float]) -> NDArray[np.float32]:
    """``depth_m`` with 0 wherever it lies outside of (nearest, farthest)."""
    near, far = depth_range_m
    return np.where((depth_m >= near) & (depth_m <= far), depth_m, np.float32(0.0))
