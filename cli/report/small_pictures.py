"""Many pictures in few bytes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

#: (width [px], WebP quality), the best first.
_LADDER = ((480, 60), (400, 50), (320, 45), (256, 40), (208, 35), (160, 30))
_SAMPLES = 12


def small_pictures(jpegs: Sequence[bytes], budget_bytes: int) -> list[bytes]:
    """Each picture as WebP (empty where it doesn't decode), as good as ``budget_bytes`` for all of them allows.

    Where even the smallest are too large, pictures are left out evenly (empty).
    """
    rung = next((r for r in _LADDER if _estimate(jpegs, *r) <= budget_bytes), _LADDER[-1])
    for width_px, quality in _LADDER[_LADDER.index(rung) :]:
        small = [small_picture(jpeg, width_px, quality) for jpeg in jpegs]
        if (total := sum(map(len, small))) <= budget_bytes:
            return small
    keep_each = math.ceil(total / max(1, budget_bytes)) + 1
    return [data if i % keep_each == 0 else b"" for i, data in enumerate(small)]


def small_picture(jpeg: bytes, width_px: int, quality: int) -> bytes:
    """A JPEG as WebP, at most ``width_px`` wide; empty where it doesn't decode."""
    if (bgr := _decoded(jpeg)) is None:
        return b""
    scale = min(1.0, width_px / bgr.shape[1])
    size = max(1, round(bgr.shape[1] * scale)), max(1, round(bgr.shape[0] * scale))
    small = cv2.resize(bgr, size, interpolation=cv2.INTER_AREA) if scale < 1.0 else bgr
    _, data = cv2.imencode(".webp", small, [cv2.IMWRITE_WEBP_QUALITY, quality])
    return bytes(data.tobytes())


def size_of(jpeg: bytes) -> tuple[int, int]:
    """Width and height [px]; (1, 1) where it doesn't decode."""
    bgr = _decoded(jpeg)
    return (1, 1) if bgr is None else (bgr.shape[1], bgr.shape[0])


def _decoded(jpeg: bytes) -> NDArray[np.uint8] | None:
    bgr: NDArray[np.uint8] | None = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR) if jpeg else None
    return bgr


def _estimate(jpegs: Sequence[bytes], width_px: int, quality: int) -> float:
    """Bytes of all, by a few."""
    some = jpegs[:: max(1, len(jpegs) // _SAMPLES)]
    return sum(len(small_picture(jpeg, width_px, quality)) for jpeg in some) / max(1, len(some)) * len(jpegs)
