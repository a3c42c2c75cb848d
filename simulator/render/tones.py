"""Light as bytes: sRGB, the tone curve, and the code of stored light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Brightness of stored light: ``light = (byte / 255) ** 2 * LIGHT_MAX``, relative to mid exposure.
LIGHT_MAX = 4.0
_TONE_STEPS = 16384
_TONE_MAX = 4.0


def to_linear(srgb: NDArray[np.floating]) -> NDArray[np.float64]:
    """Linear light of sRGB values (IEC 61966-2-1), clipped to 0-1."""
    s = np.clip(np.nan_to_num(np.asarray(srgb, dtype=np.float64)), 0.0, 1.0)
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)


def to_srgb(linear: NDArray[np.floating]) -> NDArray[np.float64]:
    """sRGB values of linear light, clipped to 0-1."""
    x = np.clip(linear, 0.0, 1.0).astype(np.float64)
    return np.asarray(np.where(x <= 0.0031308, x * 12.92, 1.055 * x ** (1 / 2.4) - 0.055), dtype=np.float64)


#: Linear value of each sRGB byte.
LINEAR_OF_BYTE = to_linear(np.arange(256) / 255.0).astype(np.float32)
#: The same in quarter steps, for colours blended from bytes.
LINEAR_OF_QUARTER = to_linear(np.arange(1024) / 1020.0).astype(np.float32)
#: Light of each stored byte.
LIGHT_OF_BYTE = ((np.arange(256) / 255.0) ** 2 * LIGHT_MAX).astype(np.float32)


def _tone_curve() -> NDArray[np.uint8]:
    """sRGB byte of linear light: straight up to the middle tones, then a soft shoulder that reaches white at 4."""
    x = np.linspace(0.0, _TONE_MAX, _TONE_STEPS)
    knee = 0.55
    over = np.maximum(x - knee, 0.0) / (1.0 - knee)
    shoulder = knee + (1.0 - knee) * (1.0 - np.exp(-over)) / (1.0 - np.exp(-(_TONE_MAX - knee) / (1.0 - knee)))
    return np.round(255.0 * to_srgb(np.where(x < knee, x, shoulder))).astype(np.uint8)


TONE = _tone_curve()
