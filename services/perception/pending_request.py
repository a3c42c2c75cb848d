"""One request about a view while a worker processes it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.bus import Answer, Refused
from surveilnav.errors import PerceptionError
from surveilnav.messages import InferRequest
from surveilnav.perception.backend import ViewTask
from surveilnav.perception.protocols import RgbdView
from surveilnav.sensing.packing import decode_rgbd
from surveilnav.sensing.views import TrueInstances, measured_depth_m
from surveilnav.services.perception.core.queue import Job
from surveilnav.services.perception.core.refusal import Refusal


@dataclass(slots=True, eq=False)
class PendingRequest:
    """A request, its intermediate results, and the future of its answer.

    Attributes:
        cache_key: where its reply is cached; empty if it isn't.
        load_truth: gets the instance ids of the view; only for backends that are told the truth.
        embedding_only: the request wants only the view's embedding, and the backend needs no detections to compute it.
        answer: completed when the request is answered or refused.
        task: the decoded view and the results of the backend's stages.
        prompt_embeddings: by prompt, its embedding (D,).
        reply: what ``answer`` will be completed with.
        processing_ms: time that stages have worked on it, without waiting for a stage.
    """

    request: InferRequest
    payload: bytes
    cache_key: bytes = b""
    load_truth: Callable[[], TrueInstances] | None = None
    embedding_only: bool = False
    answer: Future[Any] = field(default_factory=Future)
    task: ViewTask | None = None
    prompt_embeddings: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    reply: Answer | None = None
    processing_ms: float = 0.0

    @property
    def view_key(self) -> tuple[str, int, int]:
        """(source, view, seq) of the view."""
        return self.request.source, self.request.view, self.request.seq

    def is_cancelled_by(self, cancel: InferRequest) -> bool:
        """Whether ``cancel`` means this request, and not an earlier or later one about the same view."""
        r = self.request
        return (r.asker, r.source, r.view, r.stamp_ns) == (cancel.asker, cancel.source, cancel.view, cancel.stamp_ns)

    def job(self, received_ns: int) -> Job[PendingRequest]:
        """The queue's entry for this request. A robot's view is urgent; it supersedes older requests of the same asker."""
        r = self.request
        replaces = (r.asker, r.source, r.view) if r.asker else None
        return Job(self, r.source.startswith("robot/"), received_ns + r.deadline_ms * 1_000_000, replaces)

    def decode(self) -> None:
        """Decodes the payload into ``task``. Raises WireError if the picture can't be decoded, Refused if there is no truth."""
        r = self.request
        assert r.camera is not None, "check_view() was called before"
        assert r.image is not None, "check_view() was called before"
        assert r.depth is not None, "check_view() was called before"
        rgb, depth_m = decode_rgbd(self.payload, r.image, r.depth, r.camera, r.depth_range_m)
        truth = self.load_truth() if self.load_truth is not None else None
        self.task = ViewTask(
            RgbdView(rgb, measured_depth_m(depth_m, r.depth_source), r.camera), r.prompts, truth, self.view_key
        )
        self.payload = b""

    def refuse(self, error: Exception) -> None:
        """Completes ``answer`` with an error."""
        if isinstance(error, Refusal):
            error = Refused(error.name, str(error), error.retry_after_ms)
        elif isinstance(error, PerceptionError):
            error = Refused("perception_failed", str(error))
        self.answer.set_exception(error)
