"""A backend's last stage and its embeddings of texts, which take turns: one instance serves one thread at a time."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from services.perception.asked import Asked
from services.perception.core import probe
from services.perception.core.cache import ByteCache, text_key
from surveilnav.errors import TargetError
from surveilnav.perception import Backend
from surveilnav.perception.backend import Work

_CACHE_BYTES = 16 << 20


class Embedding:
    """Embeds views in batches and texts one by one; texts embedded before are remembered."""

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._one_at_a_time, self._lock = threading.Lock(), threading.Lock()
        self._texts: ByteCache[NDArray[np.float32]] = ByteCache(_CACHE_BYTES)

    def last_stage(self, batch: Sequence[Asked], works: Sequence[Work]) -> None:
        """Runs the last stage, and leaves the vectors of each view's prompts beside it."""
        with self._one_at_a_time:
            self._backend.stages[-1].run(works)
            vectors = self._known({prompt for asked in batch for prompt in asked.request.prompts})
        for asked in batch:
            asked.vectors = {prompt: vectors[prompt] for prompt in asked.request.prompts if prompt in vectors}

    def texts(self, texts: Sequence[str]) -> list[NDArray[np.float32]]:
        """Unit vectors (D,) of texts, in their order. TargetError: one that the space has no place for."""
        if any(self._remembered(text) is None for text in texts):
            with self._one_at_a_time:
                return [self._embedded(text) for text in texts]
        return [self._embedded(text) for text in texts]

    def problem(self, texts: Sequence[str]) -> str:
        """What is wrong with the embeddings of texts; empty: nothing. A text without a place is none."""
        vectors = self._known(texts)
        return probe.text_problem(list(vectors.values()), self._backend.embedding_dim)

    def _known(self, texts: Iterable[str]) -> dict[str, NDArray[np.float32]]:
        """By text, its vector; texts that the space has no place for are left out."""
        out = {}
        for text in texts:
            try:
                out[text] = self._embedded(text)
            except TargetError:
                continue
        return out

    def _embedded(self, text: str) -> NDArray[np.float32]:
        vector = self._remembered(text)
        if vector is None:
            vector = self._backend.embed_texts([text])[0]
            with self._lock:
                self._texts.put(text_key(text), vector, vector.nbytes)
        return vector

    def _remembered(self, text: str) -> NDArray[np.float32] | None:
        with self._lock:
            return self._texts.get(text_key(text))
