"""Notices that a camera was knocked or turned: its picture's static background has moved.

Edges are compared, not brightness, so that daylight, lamps and infrared hardly matter. An average over some pictures makes
people who walk by vanish. The first average is the reference. Phase correlation (Kuglin & Hines 1975) proposes how far the
present one is shifted against it.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

WIDTH_PX = 256
#: Time between two pictures that are looked at, and the number of pictures that an average takes in.
_PERIOD_S, _AVERAGED = 1.0, 8
#: A shift counts if both pictures then agree at least so much, and by so much more than without it (Pearson's correlation).
_MIN_AGREEMENT, _CLEARLY = 0.35, 0.1
#: A shift by this angle counts once so many pictures in a row have shown it clearly.
MIN_SHIFT_RAD, _LASTING = math.radians(1.5), 15
_STEADY_RAD = math.radians(1.0)
#: How fast the reference follows what the background looks like, per picture, while it isn't shifted.
_LEARN = 0.002
_SMOOTH_PX = 1.5
#: Rolls that are tried.
_ROLLS_DEG = (0.0, -3.0, 3.0, -6.0, 6.0, -10.0, 10.0)


class ShiftDetector:
    """Follows the background of one camera's pictures. Its first pictures are the reference: they belong to its calibration."""

    def __init__(self, hfov_rad: float) -> None:
        """``hfov_rad``: the horizontal field of view of the whole picture."""
        self._rad_per_px = hfov_rad / WIDTH_PX
        self._reference: NDArray[np.float32] | None = None
        self._average: NDArray[np.float32] | None = None
        self._n, self._looked_s = 0, -1e18
        self._n_shifted, self._first_rad = 0, 0.0
        self.shift_rad = 0.0

    def observe(self, rgb: NDArray[np.uint8], now_s: float) -> None:
        """Takes in a picture (height, width, 3); more than one per second aren't looked at."""
        if now_s - self._looked_s < _PERIOD_S:
            return
        self._looked_s = now_s
        edges = _edges(rgb)
        self._n += 1
        before = edges if self._average is None else self._average
        average = self._average = before + (edges - before) * np.float32(1.0 / min(self._n, _AVERAGED))
        if self._n < _AVERAGED:
            return
        reference = average if self._reference is None else self._reference
        shift_rad = self._shift_rad(reference, average)
        if shift_rad is None:
            return  # too dark, covered, or full of people: nothing can be said
        self.shift_rad = shift_rad
        if shift_rad < MIN_SHIFT_RAD:
            self._n_shifted = 0
            self._reference = reference + np.float32(_LEARN) * (average - reference)
        elif self._n_shifted == 0 or abs(shift_rad - self._first_rad) > _STEADY_RAD:
            self._n_shifted, self._first_rad = 1, shift_rad  # a shift that changes is chance, or the camera still turns
        else:
            self._n_shifted += 1

    def _shift_rad(self, before: NDArray[np.float32], now: NDArray[np.float32]) -> float | None:
        """By which angle the background is shifted or rolled; None if that can't be told.

        Phase correlation proposes a shift for each of a few rolls; what agrees best counts, if it agrees clearly better than no
        shift at all.
        """
        still = _agreement(before, now)
        best, angle_rad = still, 0.0
        for roll_deg in _ROLLS_DEG:
            rolled = _turned(before, roll_deg)
            x, y = _shift_px(np.nan_to_num(rolled, nan=float(before.mean())), now)
            agreement = _agreement(_turned(before, roll_deg, x, y), now)
            if agreement > max(best, still + _CLEARLY):
                best = agreement
                angle_rad = max(math.hypot(x, y) * self._rad_per_px, math.radians(abs(roll_deg)))
        return angle_rad if best >= _MIN_AGREEMENT else None

    @property
    def has_moved(self) -> bool:
        """Whether the background is shifted, and has been for some time."""
        return self._n_shifted >= _LASTING


def _shift_px(before: NDArray[np.float32], now: NDArray[np.float32]) -> tuple[float, float]:
    """(x, y) by which ``now`` is shifted against ``before``."""
    window = cv2.createHanningWindow((now.shape[1], now.shape[0]), cv2.CV_32F)
    # copies, since OpenCV 5 multiplies its arguments by the window in place
    (x, y), _ = cv2.phaseCorrelate(before.copy(), now.copy(), window)
    return float(x), float(y)


def _turned(edges: NDArray[np.float32], roll_deg: float, x: float = 0.0, y: float = 0.0) -> NDArray[np.float32]:
    """``edges`` rolled about the middle and then shifted by (x, y) pixels; NaN where nothing is known."""
    height, width = edges.shape
    turn = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), roll_deg, 1.0)
    turn[:, 2] += x, y
    return np.asarray(
        cv2.warpAffine(edges, turn, (width, height), borderMode=cv2.BORDER_CONSTANT, borderValue=math.nan), np.float32
    )


def _agreement(before: NDArray[np.float32], now: NDArray[np.float32]) -> float:
    """Pearson's correlation of two pictures where both are known, -1 to 1; -1 if that is less than half."""
    both = np.isfinite(before)
    if both.mean() < 0.5:
        return -1.0
    a, b = before[both], now[both]
    a, b = a - a.mean(), b - b.mean()
    return float((a * b).sum() / max(1e-9, math.sqrt(float((a * a).sum() * (b * b).sum()))))


def _edges(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """How strong edges are, compared with their neighbourhood: 0 to about 1."""
    height = max(1, round(rgb.shape[0] * WIDTH_PX / rgb.shape[1]))
    grey = cv2.cvtColor(cv2.resize(rgb, (WIDTH_PX, height), interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), _SMOOTH_PX)
    dx, dy = cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    strength = cv2.magnitude(dx, dy)
    usual = cv2.GaussianBlur(strength, (0, 0), 16.0)
    return np.asarray(strength / (strength + usual + 4.0), np.float32)
