"""Perception on request."""

from __future__ import annotations

import msgspec

from surveilnav.geometry import Pinhole
from surveilnav.messages.base import Message
from surveilnav.messages.view import Part


class InferRequest(Message, frozen=True, kw_only=True):
    """Asks a worker about one view, or for the embeddings of texts.

    For a view the payload is ``image`` then ``depth`` as in a frame; ``source``, ``view``, ``seq`` name it.
    ``texts`` asks for text embeddings instead (no payload). ``prompts`` are class names that an
    open-vocabulary detector should look for; closed-set ones ignore them. A worker that can't answer
    before ``deadline_ms`` has passed since it got the request refuses.
    """

    source: str = ""
    view: int = 0
    seq: int = 0
    camera: Pinhole | None = None
    image: Part | None = None
    depth: Part | None = None
    depth_range_m: tuple[float, float] = (0.0, 0.0)
    prompts: list[str] = []
    texts: list[str] = []
    deadline_ms: int = 30_000


class Detection(msgspec.Struct, frozen=True):
    """One object: canonical label, score 0-1, box (x0, y0, x1, y1) in pixels, unit embedding (float16 bytes).

    ``mask`` holds the packed bits (numpy.packbits, row by row, zlib) of the box rounded outwards to whole
    pixels; empty: the whole box.
    """

    label: str
    score: float
    box_px: tuple[float, float, float, float]
    embedding: bytes
    mask: bytes = b""


class InferReply(Message, frozen=True, kw_only=True):
    """What a worker sees in one view. ``image_embedding``: float16 bytes, unit length."""

    worker: str
    backend: str
    source: str
    view: int
    seq: int
    detections: list[Detection]
    image_embedding: bytes
    latency_ms: float = 0.0


class TextReply(Message, frozen=True, kw_only=True):
    """Embeddings of texts, one float16 vector each, in the order asked."""

    worker: str
    backend: str
    embeddings: list[bytes]


class WorkerLoad(Message, frozen=True, kw_only=True):
    """Queue and speed of a worker, at 1 Hz: who asks takes the least loaded first."""

    worker: str
    backend: str
    why: str
    queued: int
    capacity: int
    latency_ms: float
