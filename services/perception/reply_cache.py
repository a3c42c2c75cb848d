"""Replies to earlier requests: in memory, and for cameras of a simulated building on disk, where the next run finds them."""

from __future__ import annotations

import threading

import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.code_fingerprint import code_fingerprint
from surveilnav.config import open_disk_cache
from surveilnav.messages import InferReply, InferRequest
from surveilnav.perception.backend import Backend
from surveilnav.services.perception.config import PerceptionSettings
from surveilnav.services.perception.core.cache import ByteCache, content_key
from surveilnav.services.perception.core.reply import CachedReply

#: Settings that change how a worker serves requests, but not what it replies.
_SERVING_SETTINGS = {
    "worker",
    "threads",
    "download",
    "capacity",
    "max_batch",
    "decoders",
    "cache_mb",
    "disk_cache_mb",
}


class ReplyCache:
    """The cached replies of one worker; thread-safe.

    Attributes:
        hits: how many requests were answered from the cache.
    """

    def __init__(self, backend: Backend, settings: PerceptionSettings) -> None:
        self._backend = backend
        # Encoded: a decoded mask takes several times as much memory.
        self._memory: ByteCache[bytes] = ByteCache(settings.cache_mb * 1_000_000)
        self._lock = threading.Lock()
        # A real camera never takes the same picture twice, to the byte.
        is_repeatable = settings.simulated and not backend.needs_truth
        self._folder = (
            open_disk_cache("answers", b"surveilnav answer 1", settings.disk_cache_mb) if is_repeatable else None
        )
        self.hits = 0
        program = code_fingerprint("surveilnav", "surveilnav.services.perception") if self._folder is not None else ""
        self._program = f"{program} {backend.name} {settings.model_dump_json(exclude=_SERVING_SETTINGS)}"

    def key_for(self, request: InferRequest, payload: bytes) -> bytes:
        """The cache key of a request. With a closed vocabulary it doesn't depend on the prompts."""
        if not self._backend.needs_prompts:
            request = msgspec.structs.replace(request, prompts=[])
        return content_key(request, payload, self._backend.models, self._program)

    def get(self, key: bytes) -> CachedReply | None:
        with self._lock:
            data = self._memory.get(key)
        cached = CachedReply.from_bytes(data) if data is not None else None
        if cached is None and self._folder is not None:
            cached = self._folder.read(key.hex(), lambda parts: CachedReply.from_bytes(parts[0]), msgspec.DecodeError)
            if cached is not None:
                self._store(key, cached.to_bytes())
        with self._lock:
            self.hits += cached is not None
        return cached

    def put(self, key: bytes, reply: InferReply, image_embedding: NDArray[np.float32]) -> None:
        """Caches a reply. ``image_embedding``: the view's embedding (D,) before it was rounded for the reply."""
        data = CachedReply(reply, image_embedding.astype(np.float32).tobytes()).to_bytes()
        self._store(key, data)
        if self._folder is not None and reply.source.startswith("camera/"):
            self._folder.put(key.hex(), [data])

    def _store(self, key: bytes, data: bytes) -> None:
        with self._lock:
            self._memory.put(key, data, len(data))
