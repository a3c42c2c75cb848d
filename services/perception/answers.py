"""What was answered before: in memory, and of a simulated building's cameras on disk, where the next run finds it."""

from __future__ import annotations

import threading

import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.config import cache_called
from surveilnav.messages import InferReply, InferRequest
from surveilnav.perception.backend import Backend
from surveilnav.program import program_id
from surveilnav.services.perception.config import PerceptionSettings
from surveilnav.services.perception.core.answer import Known, of_bytes, to_bytes
from surveilnav.services.perception.core.cache import AnswerCache, content_key

#: Settings that decide how a worker serves, and nothing of what it answers.
_OF_SERVING = {
    "worker",
    "threads",
    "download",
    "capacity",
    "max_batch",
    "decoders",
    "cache_mb",
    "kept_mb",
    "truth_wait_s",
    "truth_kept",
}


class Answers:
    """The answers of one worker; ``hits``: how many were known."""

    def __init__(self, backend: Backend, settings: PerceptionSettings) -> None:
        self._backend, self._memory, self._lock = backend, AnswerCache(settings.cache_mb * 1_000_000), threading.Lock()
        # A real camera's pictures never come again, to the byte.
        lasting = settings.simulated and not backend.needs_truth
        self._files = cache_called("answers", b"surveilnav answer 1", settings.kept_mb) if lasting else None
        self.hits = 0
        program = program_id("surveilnav", "surveilnav.services.perception") if self._files is not None else ""
        self._program = f"{program} {backend.name} {settings.model_dump_json(exclude=_OF_SERVING)}"

    def key_of(self, request: InferRequest, payload: bytes) -> bytes:
        """What an answer is kept under. What is found of a closed vocabulary is the same for all prompts."""
        if not self._backend.needs_prompts:
            request = msgspec.structs.replace(request, prompts=[])
        return content_key(request, payload, self._backend.models, self._program)

    def get(self, key: bytes) -> Known | None:
        """What was answered before."""
        with self._lock:
            known = self._memory.get(key)
        if known is None and self._files is not None:
            known = self._files.read(key.hex(), lambda parts: of_bytes(parts[0]), msgspec.DecodeError)
            if known is not None:
                with self._lock:
                    self._memory.put(key, to_bytes(known))
        with self._lock:
            self.hits += known is not None
        return known

    def put(self, key: bytes, reply: InferReply, image: NDArray[np.float32]) -> None:
        """Keeps an answer. ``image``: the view's embedding (D,), before it was rounded for the reply."""
        kept = to_bytes(Known(reply, image.astype(np.float32).tobytes()))
        with self._lock:
            self._memory.put(key, kept)
        if self._files is not None and reply.source.startswith("camera/"):
            self._files.put(key.hex(), [kept])
