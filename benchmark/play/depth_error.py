"""How wrong a depth network is: each picture's scale is wrong as a whole, and its depth is warped smoothly."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.messages import DepthUncertainty

_WARP_NODES = 4


@dataclass(frozen=True, slots=True)
class DepthError:
    """Depth is multiplied by e^N(0, ``scale_sigma``), drawn once per picture, and by e to the power of a smooth field:
    values from N(0, ``warp_sigma``) at the nodes of a 4 x 4 grid, interpolated between them."""

    scale_sigma: float
    warp_sigma: float

    @property
    def uncertainty(self) -> DepthUncertainty:
        """As the picture's sender states it."""
        return DepthUncertainty(self.warp_sigma, self.scale_sigma)

    def apply(self, depth_m: NDArray[np.float32], seed: int) -> NDArray[np.float32]:
        """``depth_m`` (H, W) with this error; the same for the same ``seed``."""
        rng = np.random.default_rng(seed)
        log_error = np.full((_WARP_NODES, _WARP_NODES), rng.normal(0.0, self.scale_sigma))
        log_error += rng.normal(0.0, self.warp_sigma, log_error.shape)
        height, width = depth_m.shape
        field = cv2.resize(log_error.astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
        return np.asarray(depth_m * np.exp(field), np.float32)
