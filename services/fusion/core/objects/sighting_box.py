"""Where a camera without a depth sensor saw something in its picture, so that it can be told later what it saw.

Along the ray such a camera can't tell two things apart, but across it, it is as exact as its calibration. Once the place and the
extent of an object are measured, its points are projected into the picture: if they fill the box of the detection, the camera saw
this object, and not another one before or behind it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import inverse
from surveilnav.sensing.views import DetectedObject, PosedView

#: Intersection over union of the box of the detection and that of the projected points. What was measured is often one side only.
_MIN_IOU = 0.4


@dataclass(frozen=True, slots=True, eq=False)
class SightingBox:
    """The box of one detection, and how its camera projects.

    Attributes:
        source: of the view.
        projection: (3, 4) from the world [m] to homogeneous pixels.
        box_px: (x0, y0, x1, y1).
    """

    source: str
    projection: NDArray[np.float64]
    box_px: tuple[float, float, float, float]

    @classmethod
    def from_detection(cls, view: PosedView, detection: DetectedObject) -> SightingBox:
        c = view.camera
        K = np.array([[c.fx_px, 0.0, c.cx_px], [0.0, c.fy_px, c.cy_px], [0.0, 0.0, 1.0]])
        return cls(view.source, K @ inverse(view.T_world_camera)[:3], detection.box_px)

    def shows(self, p_world: NDArray[np.float64]) -> bool:
        """Whether the points (N, 3) of an object [m, world] fill the box."""
        x, y, z = self.projection[:, :3] @ p_world.T + self.projection[:, 3:]
        if (z <= 0.05).any():
            return False
        u, v = x / z, y / z
        low, high = np.array([u.min(), v.min()]), np.array([u.max(), v.max()])
        box_low, box_high = np.array(self.box_px[:2]), np.array(self.box_px[2:])
        common = np.prod(np.maximum(0.0, np.minimum(high, box_high) - np.maximum(low, box_low)))
        union = np.prod(high - low) + np.prod(box_high - box_low) - common
        return bool(common >= _MIN_IOU * union)

    def state(self) -> list[Any]:
        """Everything as plain values, for ``from_state``."""
        return [self.source, self.projection, list(self.box_px)]

    @classmethod
    def from_state(cls, row: list[Any]) -> SightingBox:
        source, projection, (x0, y0, x1, y1) = row
        return cls(source, projection, (x0, y0, x1, y1))
