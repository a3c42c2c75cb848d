"""Decides which pictures of a living camera are worth sending: those that show something new.

Noise, compression and slow daylight change every pixel a little. The detector compares blurred brightness, after taking out
one gain and offset for the whole picture, and counts blocks that differ by more than the noise that it has measured in them.
Blocks that differ by less drift into what later pictures are compared with, so that shadows may wander.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

_SIZE_PX = (64, 48)
#: A block has changed if it differs by more than this many times its usual difference, and by more than this of 255.
_SIGMAS, _MIN_DIFFERENCE = 4.0, 8.0
#: Number of changed blocks from which a picture is worth sending; a person at ten metres covers about ten blocks of 3,072.
_MIN_BLOCKS = 4
_LEARN = 0.05


class ChangeDetector:
    """Follows the pictures of one camera. The last picture that was sent is what others are compared with."""

    def __init__(self) -> None:
        self._sent: NDArray[np.float32] | None = None
        self._previous: NDArray[np.float32] | None = None
        self._noise = np.full(_SIZE_PX[::-1], 2.0, np.float32)

    def observe(self, rgb: NDArray[np.uint8]) -> bool:
        """Takes in the next picture. True if it is worth sending: it shows something else than the one that was sent last."""
        now = _blocks(rgb)
        previous, self._previous = self._previous, now
        if previous is not None:  # from one picture to the next most blocks show the same: their difference is noise
            step = np.abs(_aligned(previous, now) - now)
            quiet = step < _SIGMAS * self._noise + _MIN_DIFFERENCE
            self._noise[quiet] += _LEARN * (step[quiet] - self._noise[quiet])
        if self._sent is None:
            return True
        sent = _aligned(self._sent, now)
        changed = np.abs(sent - now) > np.maximum(_MIN_DIFFERENCE, _SIGMAS * self._noise)
        self._sent = np.where(changed, sent, sent + _LEARN * (now - sent))
        return int(changed.sum()) >= _MIN_BLOCKS

    def sent(self, rgb: NDArray[np.uint8]) -> None:
        """Records that a picture was sent."""
        self._sent = _blocks(rgb)


def _blocks(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    return np.asarray(cv2.resize(grey, _SIZE_PX, interpolation=cv2.INTER_AREA), np.float32)


def _aligned(before: NDArray[np.float32], now: NDArray[np.float32]) -> NDArray[np.float32]:
    """``before`` with the gain and offset that bring it nearest to ``now``.

    They are those of the quartiles, so that a person who walks in doesn't count as light.
    """
    low, high = np.percentile(before, (25, 75)), np.percentile(now, (25, 75))
    spread = float(low[1] - low[0])
    gain = float(np.clip((high[1] - high[0]) / spread, 0.5, 2.0)) if spread > 4.0 else 1.0
    return np.asarray(np.clip(gain * (before - low.mean()) + high.mean(), 0.0, 255.0), np.float32)
