"""What of a picture shows an object: its box with some of what is around it, as a small JPEG."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

#: So much of the box's size is shown around it, and at least so many pixels.
_MARGIN, _LEAST_PX = 0.35, 24
#: Longer sides are scaled down.
_MOST_PX = 320
_QUALITY = 82
_FRAME_BGR = (60, 200, 255)


def crop(jpeg: bytes, box_px: Sequence[float | None]) -> bytes:
    """The picture around a box (x0, y0, x1, y1) [px], with the box drawn.

    Raises:
        ValueError: it is no picture, or the box has no place in it.
    """
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR) if jpeg else None
    if picture is None:
        raise ValueError("no JPEG")
    height, width = picture.shape[:2]
    if len(box_px) != 4 or any(v is None or not np.isfinite(v) for v in box_px):
        raise ValueError(f"no box: {box_px}")
    x0, y0, x1, y1 = (float(np.clip(v or 0.0, 0, most)) for v, most in zip(box_px, (width, height) * 2, strict=True))
    if not (x1 - x0 >= 1 and y1 - y0 >= 1):
        raise ValueError(f"the box {box_px} isn't in a picture of {width} x {height}")
    around = max(_MARGIN * max(x1 - x0, y1 - y0), _LEAST_PX)
    left, top = int(max(x0 - around, 0)), int(max(y0 - around, 0))
    right, bottom = int(min(x1 + around, width)), int(min(y1 + around, height))
    scale = min(1.0, _MOST_PX / max(right - left, bottom - top))
    size = max(1, round((right - left) * scale)), max(1, round((bottom - top) * scale))
    small = cv2.resize(picture[top:bottom, left:right], size, interpolation=cv2.INTER_AREA)
    corners = [(round((x - left) * scale), round((y - top) * scale)) for x, y in ((x0, y0), (x1, y1))]
    cv2.rectangle(small, corners[0], corners[1], _FRAME_BGR, 2)
    return cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
