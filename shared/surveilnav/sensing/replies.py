"""What perception sees in a view, as a worker's reply, and back. Any fault in received data raises ``WireError``."""

from __future__ import annotations

import math
from typing import Final

from surveilnav.errors import WireError
from surveilnav.geometry import Pinhole
from surveilnav.messages import Detection, InferReply
from surveilnav.sensing import rle
from surveilnav.sensing.packing import MAX_LABEL_CHARS, MAX_NAMES, pack_embedding, unpack_embedding
from surveilnav.sensing.views import DetectedObject, ViewPerception, box_cells

MAX_DETECTIONS: Final = 1000


def perception_to_wire(perception: ViewPerception) -> tuple[list[Detection], bytes]:
    """The detections and the image embedding in the form of an ``InferReply``."""
    detections = [
        Detection(
            label=d.label,
            score=float(d.score),
            box_px=d.box_px,
            embedding=pack_embedding(d.embedding),
            mask=[] if d.mask is None else rle.encode(d.mask),
            chance=d.chance,
        )
        for d in perception.detections
    ]
    return detections, pack_embedding(perception.image_embedding)


def perception_from_wire(reply: InferReply, camera: Pinhole) -> ViewPerception:
    """Decodes a worker's reply about a view of ``camera``. Boxes are clipped to the picture.

    Raises:
        WireError: a value in it is invalid.
    """
    image_embedding = unpack_embedding(reply.image_embedding)
    if len(reply.detections) > MAX_DETECTIONS:
        raise WireError(f"a view has up to {MAX_DETECTIONS} detections, got {len(reply.detections)}")
    if bad := [value for value in reply.relevance.values() if not -1.0 <= value <= 1.0]:
        raise WireError(f"a relevance lies between -1 and 1, got {bad[0]}")
    detections = tuple(_detected(d, camera, image_embedding.size) for d in reply.detections)
    if len(reply.words) > MAX_NAMES or any(len(word) > MAX_LABEL_CHARS for word in reply.words):
        raise WireError(f"a view is looked at for up to {MAX_NAMES} words of {MAX_LABEL_CHARS} characters")
    words = tuple(reply.words)
    return ViewPerception(reply.backend, detections, image_embedding, reply.models.embedder, words)


def _detected(d: Detection, camera: Pinhole, dim: int) -> DetectedObject:
    x0, y0, x1, y1 = d.box_px
    if not all(math.isfinite(v) for v in d.box_px):
        raise WireError(f"a box must be finite, got {d.box_px}")
    x0, x1 = max(x0, 0.0), min(x1, float(camera.width_px))
    y0, y1 = max(y0, 0.0), min(y1, float(camera.height_px))
    if not (x0 < x1 and y0 < y1):
        size = f"{camera.width_px}x{camera.height_px}"
        raise WireError(f"a box (x0, y0, x1, y1) must have its pixels in a picture of {size}, got {d.box_px}")
    if not 0.0 <= d.score <= 1.0:
        raise WireError(f"a score lies between 0 and 1, got {d.score}")
    if d.chance is not None and not 0.0 <= d.chance <= 1.0:
        raise WireError(f"a chance lies between 0 and 1, got {d.chance}")
    if not 1 <= len(d.label) <= MAX_LABEL_CHARS:
        raise WireError(f"a label has 1 to {MAX_LABEL_CHARS} characters, got {len(d.label)}")
    left, top, right, bottom = box_cells((x0, y0, x1, y1), camera.width_px, camera.height_px)
    mask = rle.decode(d.mask, right - left, bottom - top) if d.mask else None
    return DetectedObject(d.label, d.score, (x0, y0, x1, y1), mask, unpack_embedding(d.embedding, dim), d.chance)
