"""Perception on request."""

from __future__ import annotations

import msgspec

from surveilnav.geometry import Pinhole
from surveilnav.messages.base import Message
from surveilnav.messages.view import PayloadPart


class InferRequest(Message, frozen=True, kw_only=True):
    """Asks a worker about one view, or for the embeddings of texts.

    For a view the payload is ``image`` then ``depth`` as in a frame; ``source``, ``view``, ``seq`` name it.
    ``texts`` asks for text embeddings instead (no payload). ``prompts`` are words that an open-vocabulary detector
    should look for; closed-set ones ignore them. ``detects`` false: only the view's embedding is wanted. A worker that
    can't answer before ``deadline_ms`` has passed since it got the request refuses. ``asker`` names who asks, if it
    wants a newer request of its own about the same view to take the place of one that still waits. ``cancel``: the
    ``asker`` has no use any more for what it asked with this ``stamp_ns`` about this view; the answer is empty.
    """

    source: str = ""
    view: int = 0
    seq: int = 0
    camera: Pinhole | None = None
    image: PayloadPart | None = None
    depth: PayloadPart | None = None
    depth_range_m: tuple[float, float] = (0.0, 0.0)
    prompts: list[str] = []
    texts: list[str] = []
    deadline_ms: int = 30_000
    detects: bool = True
    asker: str = ""
    cancel: bool = False


class ModelIds(msgspec.Struct, frozen=True, omit_defaults=True):
    """Which models answered; empty where there is none. ``embedder`` names the space of all vectors in the answer."""

    detector: str = ""
    segmenter: str = ""
    embedder: str = ""


class Detection(msgspec.Struct, frozen=True):
    """One object: canonical label, score 0-1, box (x0, y0, x1, y1) in pixels, unit embedding (float16 bytes).

    ``mask`` holds the run lengths of the box rounded outwards to whole pixels, as ``surveilnav.sensing.rle`` writes
    them; empty: the whole box. ``chance``: how likely it is what it is called, 0-1; None: the worker's backend isn't
    calibrated.
    """

    label: str
    score: float
    box_px: tuple[float, float, float, float]
    embedding: bytes
    mask: list[int] = []
    chance: float | None = None


class InferReply(Message, frozen=True, kw_only=True):
    """What a worker sees in one view.

    ``image_embedding``: float16 bytes, unit length. ``relevance``: by prompt, the cosine of the view's embedding with
    the prompt's own (-1 to 1); prompts that the space has no place for are missing. ``words``: what the detector looked
    for; all its names, if it has a vocabulary.
    """

    worker: str
    backend: str
    source: str
    view: int
    seq: int
    detections: list[Detection]
    image_embedding: bytes
    latency_ms: float = 0.0
    relevance: dict[str, float] = {}
    models: ModelIds = ModelIds()
    words: list[str] = []


class TextReply(Message, frozen=True, kw_only=True):
    """Embeddings of texts, one float16 vector each, in the order asked. ``models.embedder`` names their space.

    ``words``: what the worker's vocabulary calls the thing that each text names ("Fernseher": "tv"); empty: nothing, or
    it knows any word. ``vocabulary``: all names that it has; empty: it knows any word.
    """

    worker: str
    backend: str
    embeddings: list[bytes]
    words: list[str] = []
    models: ModelIds = ModelIds()
    vocabulary: list[str] = []


class WorkerLoad(Message, frozen=True, kw_only=True):
    """Queue and speed of a worker, at 1 Hz: who asks takes the least loaded first.

    ``ready``: its answer to a probe picture was well-formed; before that it refuses views and texts. ``times``: by stage
    ("queue", "decode", then the backend's own), how many views took how long, in the buckets of
    ``surveilnav.histogram``, since it started. ``cached``: how many views it knew the answer to.
    ``open_vocabulary``: it looks for whatever words it is given. ``calibrated``: its detections have chances.
    """

    worker: str
    backend: str
    why: str
    queued: int
    capacity: int
    latency_ms: float
    ready: bool = True
    models: ModelIds = ModelIds()
    times: dict[str, list[int]] = {}
    cached: int = 0
    open_vocabulary: bool = False
    calibrated: bool = False
