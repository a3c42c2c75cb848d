"""When a robot stands still, and when a camera has seen its tag well enough meanwhile."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: So long a robot has to stand: streams show what was a second or two ago.
STILL_S = 2.0
#: A robot's own estimate of its pose moves a little while it stands.
_SHAKES_M, _SHAKES_RAD = 0.02, math.radians(1.0)
#: After such a time without word of the robot it may have moved in between.
_MAX_GAP_S = 1.5
_PICTURES = 3
_MAX_SPREAD_PX = 1.5
#: After so many pictures without the tag a camera isn't expected to see it from this stop.
_MAX_WITHOUT = 8


@dataclass(frozen=True, slots=True)
class Standstill:
    """A robot that stands. ``since_s`` identifies the stop: it stays while the robot stays."""

    since_s: float
    x_m: float
    y_m: float
    yaw_rad: float


class StandstillDetector:
    """Tells from a robot's poses whether it stands. Times are those of one clock that never goes back."""

    def __init__(self) -> None:
        self._since_s = self._last_s = -math.inf
        self._poses: list[tuple[float, float, float]] = []

    def observe(self, now_s: float, x_m: float, y_m: float, yaw_rad: float) -> Standstill | None:
        """The stop, once the robot has stood for ``STILL_S``; its pose is the median of all that the robot said there."""
        gap_s, self._last_s = now_s - self._last_s, now_s
        if gap_s > _MAX_GAP_S or self._moved(x_m, y_m, yaw_rad):
            self._since_s, self._poses = now_s, []
        self._poses.append((x_m, y_m, yaw_rad))
        if now_s - self._since_s < STILL_S:
            return None
        yaw0 = self._poses[0][2]
        turned = [_wrapped(yaw - yaw0) for _, _, yaw in self._poses]
        x, y = np.median([pose[:2] for pose in self._poses], axis=0)
        return Standstill(self._since_s, float(x), float(y), _wrapped(yaw0 + float(np.median(turned))))

    def _moved(self, x_m: float, y_m: float, yaw_rad: float) -> bool:
        if not self._poses:
            return True
        x0, y0, yaw0 = self._poses[0]
        return math.hypot(x_m - x0, y_m - y0) > _SHAKES_M or abs(_wrapped(yaw_rad - yaw0)) > _SHAKES_RAD


class SteadyCorners:
    """The corners of the tag in one camera's pictures during one stop.

    A delayed stream still shows the robot driving; so three pictures in a row have to agree.

    Attributes:
        corners_px: (4, 2), the median of the pictures that agree; None: none yet.
        done: they are there, or the camera doesn't see the tag from this stop.
    """

    def __init__(self) -> None:
        self.corners_px: NDArray[np.float64] | None = None
        self._recent: deque[NDArray[np.float64]] = deque(maxlen=_PICTURES)
        self._n_without = 0

    @property
    def done(self) -> bool:
        return self.corners_px is not None or self._n_without >= _MAX_WITHOUT

    def observe(self, corners_px: NDArray[np.float64] | None) -> None:
        """Adds what the next picture shows: corners (4, 2), or no tag."""
        if corners_px is None:
            self._n_without += 1
            self._recent.clear()
            return
        self._recent.append(corners_px)
        if len(self._recent) == _PICTURES:
            pictures = np.array(self._recent)
            middle = np.median(pictures, axis=0)
            if np.linalg.norm(pictures - middle, axis=-1).max() <= _MAX_SPREAD_PX:
                self.corners_px = middle


def _wrapped(angle_rad: float) -> float:
    """The angle between -pi and pi."""
    return math.remainder(angle_rad, 2 * math.pi)
