"""The picture of a view with its detections, as SVG around a JPEG."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

import cv2
import numpy as np

from surveilnav.cli.report.svg import data_uri, drawing, tag

#: x0, y0, x1, y1 [px], label, score.
Box = tuple[float, float, float, float, str, float]


def view_svg(jpeg: bytes, boxes: Iterable[Box], target: str, title: str, width_px: int = 760) -> str | None:
    """A view with its detections, the target's on top; None if the JPEG doesn't decode."""
    bgr = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR) if jpeg else None
    if bgr is None:
        return None
    scale = min(1.0, width_px / bgr.shape[1])
    if scale < 1.0:
        bgr = cv2.resize(bgr, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    height, width = bgr.shape[:2]
    _, small = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 85])
    parts = [tag("image", href=data_uri("jpeg", small.tobytes()), width=width, height=height)]
    font_px = max(11.0, width / 48)
    parts += [_detection(b, scale, font_px, b[4] == target) for b in sorted(boxes, key=lambda b: b[4] == target)]
    return drawing((width, height), parts, title, "view")


def _detection(box: Box, scale: float, font_px: float, hit: bool) -> str:
    """A box in the picture's pixels times ``scale``, with label and score above it."""
    x0, y0, x1, y1 = (v * scale for v in box[:4])
    text, line_px = f"{box[4]} {box[5]:.2f}", font_px * 1.4
    y = max(y0, line_px)
    frame = tag("rect", x=x0, y=y0, width=x1 - x0, height=y1 - y0)
    ground = tag("rect", class_="tag", x=x0, y=y - line_px, width=len(text) * font_px * 0.58 + 8, height=line_px)
    words = tag("text", escape(text), x=x0 + 4, y=y - font_px * 0.38, font_size=font_px)
    return tag("g", frame, ground, words, class_="box hit" if hit else "box")
