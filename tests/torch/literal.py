"""Slow literal code for what networks are fed, written from the papers and from what Pillow documents."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

IMAGENET = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
OPENAI = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)


def triangle(x: float) -> float:
    """Bilinear interpolation as a filter."""
    return max(0.0, 1.0 - abs(x))


def cubic(x: float) -> float:
    """Keys' bicubic filter with a = -0.5."""
    x = abs(x)
    if x < 1:
        return 1.5 * x**3 - 2.5 * x**2 + 1
    return -0.5 * x**3 + 2.5 * x**2 - 4 * x + 2 if x < 2 else 0.0


def resized_line(line: list[float], n: int, kernel: Callable[[float], float], reach: float) -> list[float]:
    """A line of samples with ``n`` of them: each the mean of those under the filter, which is widened where the line
    shrinks, so that none is left out."""
    scale = len(line) / n
    wide = max(scale, 1.0)
    out = []
    for i in range(n):
        centre = (i + 0.5) * scale
        first, last = max(0, int(centre - reach * wide + 0.5)), min(len(line), int(centre + reach * wide + 0.5))
        weights = [kernel((j + 0.5 - centre) / wide) for j in range(first, last)]
        total = sum(w * line[j] for w, j in zip(weights, range(first, last), strict=True))
        out.append(min(255.0, max(0.0, math.floor(total / sum(weights) + 0.5))))
    return out


def resized(rgb: NDArray[np.uint8], height: int, width: int, kernel: Callable[[float], float], reach: float) -> NDArray:
    """(height, width, 3): along the rows first, then along the columns, rounded to bytes after each."""
    out = np.zeros((height, width, 3))
    for channel in range(3):
        rows = [resized_line(list(map(float, row)), width, kernel, reach) for row in rgb[..., channel]]
        columns = [resized_line([row[x] for row in rows], height, kernel, reach) for x in range(width)]
        for x, column in enumerate(columns):
            out[:, x, channel] = column
    return out


def normalised(picture: NDArray, means: tuple[float, ...], deviations: tuple[float, ...]) -> NDArray:
    """(3, height, width) of (height, width, 3) of 0-255."""
    out = np.zeros((3, *picture.shape[:2]))
    for channel in range(3):
        out[channel] = (picture[..., channel] / 255.0 - means[channel]) / deviations[channel]
    return out
