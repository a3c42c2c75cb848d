"""Requests to perception workers, and their replies."""

from __future__ import annotations

import msgspec

from surveilnav.geometry import Pinhole
from surveilnav.messages.base import Message
from surveilnav.messages.view import DepthSource, PayloadPart


class InferRequest(Message, frozen=True, kw_only=True):
    """Asks a worker about one view, or for the embeddings of texts.

    Attributes:
        source, view, seq: identify the view.
        camera, image, depth, depth_range_m: describe the payload, which is the encoded image, then depth, as in a frame.
        depth_source: where the depth comes from; detectors use only what a sensor measured.
        prompts: words that an open-vocabulary detector should look for; closed-set detectors ignore them.
        texts: texts to embed. Such a request has no view and no payload.
        deadline_ms: the worker refuses the request if it can't answer within this time after it arrived.
        detects: False if only the view's embedding is wanted.
        asker: identifies who asks. A newer request of the same asker about the same view supersedes one that still waits.
        handed: the name under which the payload lies in the folder that the worker sees, too (``HandoverFolder``); then there is
            none here.
        cancel: cancels the ``asker``'s earlier request with this ``stamp_ns`` about this view. The answer is empty.
    """

    source: str = ""
    view: int = 0
    seq: int = 0
    camera: Pinhole | None = None
    image: PayloadPart | None = None
    depth: PayloadPart | None = None
    depth_range_m: tuple[float, float] = (0.0, 0.0)
    depth_source: DepthSource = "sensor"
    prompts: list[str] = []
    texts: list[str] = []
    deadline_ms: int = 30_000
    detects: bool = True
    asker: str = ""
    handed: str = ""
    cancel: bool = False


class ModelIds(msgspec.Struct, frozen=True, omit_defaults=True):
    """Ids of the models that answered; empty if there is none. ``embedder`` is the space of all embeddings in the answer."""

    detector: str = ""
    segmenter: str = ""
    embedder: str = ""


class Detection(msgspec.Struct, frozen=True):
    """One object in a view.

    Attributes:
        label: its canonical name.
        score: the detector's score, 0-1.
        box_px: (x0, y0, x1, y1).
        embedding: unit vector as float16 bytes.
        mask: run lengths (``surveilnav.sensing.rle``) for the box rounded outwards to whole pixels; empty: the whole box.
        chance: calibrated probability that the label is right, 0-1; None: the worker's backend isn't calibrated.
    """

    label: str
    score: float
    box_px: tuple[float, float, float, float]
    embedding: bytes
    mask: list[int] = []
    chance: float | None = None


class InferReply(Message, frozen=True, kw_only=True):
    """What a worker found in one view.

    Attributes:
        image_embedding: unit vector as float16 bytes.
        latency_ms: time that the worker processed the view, without waiting for a stage.
        relevance: by prompt, the cosine of the view's and the prompt's embeddings, -1 to 1. Prompts that can't be embedded
            are missing.
        words: what the detector looked for: the prompts, or all classes of its vocabulary.
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
    """Embeddings of texts.

    Attributes:
        embeddings: unit vectors as float16 bytes, in the order of the texts.
        words: for each text, the class of the worker's vocabulary that it names ("Fernseher": "tv"); empty if there is
            none, or the vocabulary is open.
        vocabulary: all classes; empty if the vocabulary is open.
    """

    worker: str
    backend: str
    embeddings: list[bytes]
    words: list[str] = []
    models: ModelIds = ModelIds()
    vocabulary: list[str] = []


class WorkerLoad(Message, frozen=True, kw_only=True):
    """How busy and how fast a worker is, at 1 Hz. Clients ask the least loaded worker first.

    Attributes:
        why: why it runs this backend, for people.
        queued: requests that wait or are processed, of at most ``capacity``.
        latency_ms: mean time to process a view, without waiting for a stage.
        ready: whether it has passed its probe; before that it refuses all requests.
        times: by stage ("queue", "decode", the backend's, "answer"), how many views took how long since it started, in the
            buckets of ``surveilnav.histogram``. A load is published without them if nothing was processed since the one before.
        cached: number of requests answered from the cache.
        open_vocabulary: whether it looks for any word.
        calibrated: whether its detections have a ``chance``.
        handover: the token of the folder in which it can be handed pictures; empty: they are sent.
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
    handover: str = ""

    def to_publish(self, known_times: dict[str, list[int]]) -> WorkerLoad:
        """What is published of it, if the others know ``known_times``."""
        return msgspec.structs.replace(self, times={}) if self.times == known_times else self

    def merged(self, later: WorkerLoad) -> WorkerLoad:
        """All that is known by this load and a ``later`` one of the same worker."""
        return later if later.times else msgspec.structs.replace(later, times=self.times)
