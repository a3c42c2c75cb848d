"""What a finished view becomes on the bus."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

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
        stamp_ns=stamp_ns, worker=worker, backend=seen.backend, source=request.source, view=request.view, seq=request.seq,
        detections=detections if request.detects else [], image_embedding=image_embedding, latency_ms=latency_ms,
        relevance=relevance(seen.image_embedding, request.prompts, vectors), models=models,
        words=list(seen.words) if request.detects else [],
    )  # fmt: skip
