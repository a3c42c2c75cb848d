"""One view that somebody asked about, on its way through a worker."""

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
from surveilnav.perception.backend import Work
from surveilnav.perception.protocols import RgbdView
from surveilnav.sensing.packing import decode_rgbd
from surveilnav.services.perception.core.queue import Job
from surveilnav.services.perception.core.refusal import Refusal


@dataclass(slots=True, eq=False)
class Asked:
    """What was asked, what became of it so far, and the answer to come.

    Attributes:
        told: gives what each pixel shows; only for backends that need it.
        key: what its answer is kept under; empty: it isn't kept.
        only_embeds: the view's embedding is all that is wanted, and the backend needs nothing else for it.
        work: the decoded view, for the backend's stages.
        vectors: the embeddings of its prompts.
        reply: what it will be answered with.
        busy_ms: how long stages worked on it.
    """

    request: InferRequest
    payload: bytes
    key: bytes = b""
    told: Callable[[], Any] | None = None
    only_embeds: bool = False
    answer: Future[Any] = field(default_factory=Future)
    work: Work | None = None
    vectors: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    reply: Answer | None = None
    busy_ms: float = 0.0

    @property
    def view_key(self) -> tuple[str, int, int]:
        """What names the view."""
        return self.request.source, self.request.view, self.request.seq

    def is_meant_by(self, cancel: InferRequest) -> bool:
        """Whether a request to cancel is about this one, and not about an earlier or later one for the same view."""
        r = self.request
        return (r.asker, r.source, r.view, r.stamp_ns) == (cancel.asker, cancel.source, cancel.view, cancel.stamp_ns)

    def job(self, received_ns: int) -> Job[Asked]:
        """What waits of it: a robot's view is urgent, and a newer request by the same asker makes it needless."""
        r = self.request
        replaces = (r.asker, r.source, r.view) if r.asker else None
        return Job(self, r.source.startswith("robot/"), received_ns + r.deadline_ms * 1_000_000, replaces)

    def decode(self) -> None:
        """Makes pixels of the payload. WireError: there are none in it."""
        r = self.request
        assert r.camera is not None, "checked before it was let in"
        assert r.image is not None, "checked before it was let in"
        assert r.depth is not None, "checked before it was let in"
        rgb, depth_m = decode_rgbd(self.payload, r.image, r.depth, r.camera, r.depth_range_m)
        truth = self.told() if self.told is not None else None
        self.work = Work(RgbdView(rgb, depth_m, r.camera), r.prompts, truth, self.view_key)
        self.payload = b""

    def refuse(self, error: Exception) -> None:
        """Ends it without an answer: says why."""
        if isinstance(error, Refusal):
            error = Refused(error.name, str(error), error.retry_after_ms)
        elif isinstance(error, PerceptionError):
            error = Refused("perception_failed", str(error))
        self.answer.set_exception(error)
