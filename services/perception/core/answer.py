"""What a finished view becomes on the bus."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.messages import InferReply, InferRequest, ModelIds
from surveilnav.sensing.packing import perception_to_wire
from surveilnav.sensing.views import ViewPerception


def relevance(
    image_embedding: NDArray[np.float32], prompts: Sequence[str], vectors: Mapping[str, NDArray[np.float32]]
) -> dict[str, float]:
    """By prompt, the cosine of a view's embedding (D,) with the prompt's (D,); prompts without a vector are left out."""
    cosines = {p: float(np.dot(image_embedding, vectors[p])) for p in prompts if p in vectors}
    return {prompt: min(1.0, max(-1.0, cosine)) for prompt, cosine in cosines.items()}


def reply_to(
    request: InferRequest,
    seen: ViewPerception,
    vectors: Mapping[str, NDArray[np.float32]],
    *,
    models: ModelIds,
    worker: str,
    latency_ms: float,
    stamp_ns: int,
) -> InferReply:
    """The reply to a request: what was seen, and how relevant the view is to each prompt, by the prompts' ``vectors``."""
    detections, image_embedding = perception_to_wire(seen)
    return InferReply(
        stamp_ns=stamp_ns,
        worker=worker,
        backend=seen.backend,
        source=request.source,
        view=request.view,
        seq=request.seq,
        detections=detections if request.detects else [],
        image_embedding=image_embedding,
        latency_ms=latency_ms,
        relevance=relevance(seen.image_embedding, request.prompts, vectors),
        models=models,
        words=list(seen.words) if request.detects else [],
    )


class Known(msgspec.Struct, frozen=True):
    """What is kept of an answer: the reply, and the view's embedding (D,) float32 as it was before it was rounded for it."""

    reply: InferReply
    image: bytes

    def to(
        self, request: InferRequest, vectors: Mapping[str, NDArray[np.float32]], *, worker: str, stamp_ns: int
    ) -> InferReply:
        """The same answer to another request, with prompts of its own."""
        return msgspec.structs.replace(
            self.reply,
            stamp_ns=stamp_ns,
            worker=worker,
            source=request.source,
            view=request.view,
            seq=request.seq,
            latency_ms=0.0,
            relevance=relevance(np.frombuffer(self.image, np.float32), request.prompts, vectors),
        )


def to_bytes(answer: Known) -> bytes:
    """An answer to be kept."""
    return bytes(memoryview(msgspec.msgpack.encode(answer)))  # a copy: the encoder's lies in a larger block


def of_bytes(kept: bytes) -> Known:
    """An answer that was kept. msgspec.DecodeError: it wasn't one."""
    return msgspec.msgpack.decode(kept, type=Known)
