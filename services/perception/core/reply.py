"""The reply to a request about a view, and its cached form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.messages import InferReply, InferRequest, ModelIds
from surveilnav.sensing.replies import perception_to_wire
from surveilnav.sensing.views import ViewPerception


def relevance(
    image_embedding: NDArray[np.float32], prompts: Sequence[str], prompt_embeddings: Mapping[str, NDArray[np.float32]]
) -> dict[str, float]:
    """By prompt, the cosine between a view's embedding (D,) and the prompt's (D,). Prompts without one are left out."""
    cosines = {p: float(np.dot(image_embedding, prompt_embeddings[p])) for p in prompts if p in prompt_embeddings}
    return {prompt: min(1.0, max(-1.0, cosine)) for prompt, cosine in cosines.items()}


def build_reply(
    request: InferRequest,
    perception: ViewPerception,
    prompt_embeddings: Mapping[str, NDArray[np.float32]],
    *,
    models: ModelIds,
    worker: str,
    latency_ms: float,
    stamp_ns: int,
) -> InferReply:
    """The reply to a request: what perception found, and how relevant the view is to each prompt."""
    detections, image_embedding = perception_to_wire(perception)
    return InferReply(
        stamp_ns=stamp_ns,
        worker=worker,
        backend=perception.backend,
        source=request.source,
        view=request.view,
        seq=request.seq,
        detections=detections if request.detects else [],
        image_embedding=image_embedding,
        latency_ms=latency_ms,
        relevance=relevance(perception.image_embedding, request.prompts, prompt_embeddings),
        models=models,
        words=list(perception.words) if request.detects else [],
    )


class CachedReply(msgspec.Struct, frozen=True):
    """A reply as it is cached. ``image_embedding``: the view's embedding (D,) as float32 bytes.

    The reply itself holds the embedding rounded to float16; the exact one is needed to compute the relevance to other
    prompts.
    """

    reply: InferReply
    image_embedding: bytes

    def reply_to(
        self, request: InferRequest, prompt_embeddings: Mapping[str, NDArray[np.float32]], *, worker: str, stamp_ns: int
    ) -> InferReply:
        """The reply to another request about the same picture, with that request's prompts."""
        return msgspec.structs.replace(
            self.reply,
            stamp_ns=stamp_ns,
            worker=worker,
            source=request.source,
            view=request.view,
            seq=request.seq,
            latency_ms=0.0,
            relevance=relevance(np.frombuffer(self.image_embedding, np.float32), request.prompts, prompt_embeddings),
        )

    def to_bytes(self) -> bytes:
        return bytes(memoryview(msgspec.msgpack.encode(self)))  # a copy: the encoder's own lies in a larger block

    @classmethod
    def from_bytes(cls, data: bytes) -> CachedReply:
        """Decodes an entry. Raises msgspec.DecodeError if it isn't one."""
        return msgspec.msgpack.decode(data, type=cls)
