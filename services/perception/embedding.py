"""A backend's last stage, which embeds views, and its embeddings of texts.

The two take turns, because a backend serves one thread at a time.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import TargetError
from surveilnav.perception.backend import Backend, ViewTask
from surveilnav.perception.prompts import prompt_refusal
from surveilnav.services.perception.core import probe
from surveilnav.services.perception.core.cache import ByteCache, text_key
from surveilnav.services.perception.pending_request import PendingRequest

_CACHE_BYTES = 16 << 20


class EmbeddingStage:
    """Embeds batches of views, and texts. Embeddings of texts are cached."""

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        #: Held while the backend's last stage runs or texts are embedded.
        self._backend_lock = threading.RLock()
        self._cache: ByteCache[NDArray[np.float32]] = ByteCache(_CACHE_BYTES)
        self._cache_lock = threading.Lock()

    def run(self, batch: Sequence[PendingRequest], tasks: Sequence[ViewTask]) -> None:
        """Runs the backend's last stage and embeds the prompts of the requests."""
        with self._backend_lock:
            self._backend.stages[-1].run(tasks)
            embeddings = self.embed_known({prompt for pending in batch for prompt in pending.request.prompts})
        for pending in batch:
            pending.prompt_embeddings = {p: embeddings[p] for p in pending.request.prompts if p in embeddings}

    def embed_texts(self, texts: Sequence[str]) -> list[NDArray[np.float32]]:
        """Unit vectors (D,) of texts, in their order.

        Raises:
            TargetError: the backend can't embed a text, or a text names a target that it can't look for.
        """
        if refused := next(filter(None, (prompt_refusal(self._backend, text) for text in texts)), ""):
            raise TargetError(refused)
        embeddings, missing = self._from_cache(texts)
        if missing:
            with self._backend_lock:
                embeddings |= self._embed(missing)
        return [embeddings[text] for text in texts]

    def embed_known(self, texts: Iterable[str]) -> dict[str, NDArray[np.float32]]:
        """By text, its unit vector (D,). Texts that the backend can't embed are left out."""
        embeddings, missing = self._from_cache(texts)
        if not missing:
            return embeddings
        with self._backend_lock:
            with suppress(TargetError):
                return embeddings | self._embed(missing)
            for text in missing:
                with suppress(TargetError):
                    embeddings |= self._embed([text])
        return embeddings

    def are_cached(self, texts: Iterable[str]) -> bool:
        """Whether all texts can be embedded without the backend."""
        return not self._from_cache(texts)[1]

    def find_problem(self, texts: Sequence[str]) -> str:
        """What is malformed in the embeddings of texts; empty if nothing is. Texts that can't be embedded are ignored."""
        return probe.find_text_problem(list(self.embed_known(texts).values()), self._backend.embedding_dim)

    def _embed(self, texts: Sequence[str]) -> dict[str, NDArray[np.float32]]:
        """Embeds and caches texts as one batch. Raises TargetError if one of them can't be embedded."""
        rows = self._backend.embed_texts(texts) if texts else ()
        # Copies: a row of the batch's array would keep the whole array in memory.
        embeddings = {text: row.copy() for text, row in zip(texts, rows, strict=True)}
        with self._cache_lock:
            for text, embedding in embeddings.items():
                self._cache.put(text_key(text), embedding, embedding.nbytes)
        return embeddings

    def _from_cache(self, texts: Iterable[str]) -> tuple[dict[str, NDArray[np.float32]], list[str]]:
        """The cached embeddings by text, and the texts without one, each once."""
        with self._cache_lock:
            cached = {text: self._cache.get(text_key(text)) for text in texts}
        embeddings = {text: vector for text, vector in cached.items() if vector is not None}
        return embeddings, [text for text in cached if text not in embeddings]
