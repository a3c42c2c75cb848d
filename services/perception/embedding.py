"""A backend's last stage and its embeddings of texts, which take turns: one instance serves one thread at a time."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import TargetError
from surveilnav.perception.backend import Backend, Work
from surveilnav.perception.prompts import word_refused
from surveilnav.services.perception.asked import Asked
from surveilnav.services.perception.core import probe
from surveilnav.services.perception.core.cache import ByteCache, text_key

_CACHE_BYTES = 16 << 20


class Embedding:
    """Embeds views in batches and texts one by one; texts embedded before are remembered."""

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._one_at_a_time, self._lock = threading.RLock(), threading.Lock()
        self._texts: ByteCache[NDArray[np.float32]] = ByteCache(_CACHE_BYTES)

    def last_stage(self, batch: Sequence[Asked], works: Sequence[Work]) -> None:
        """Runs the last stage, and leaves the vectors of each view's prompts beside it."""
        with self._one_at_a_time:
            self._backend.stages[-1].run(works)
            vectors = self.known({prompt for asked in batch for prompt in asked.request.prompts})
        for asked in batch:
            asked.vectors = {prompt: vectors[prompt] for prompt in asked.request.prompts if prompt in vectors}

    def texts(self, texts: Sequence[str]) -> list[NDArray[np.float32]]:
        """Unit vectors (D,) of texts, in their order.

        Raises:
            TargetError: one that the space has no place for, or that names a target which can't be looked for.
        """
        if refused := next(filter(None, (word_refused(self._backend, text) for text in texts)), ""):
            raise TargetError(refused)
        known, new = self._remembered(texts)
        if new:
            with self._one_at_a_time:
                known |= self._embedded(new)
        return [known[text] for text in texts]

    def problem(self, texts: Sequence[str]) -> str:
        """What is wrong with the embeddings of texts; empty: nothing. A text without a place is none."""
        vectors = self.known(texts)
        return probe.text_problem(list(vectors.values()), self._backend.embedding_dim)

    def knows(self, texts: Iterable[str]) -> bool:
        """Whether none of the texts needs the backend."""
        return not self._remembered(texts)[1]

    def known(self, texts: Iterable[str]) -> dict[str, NDArray[np.float32]]:
        """By text, its vector; texts that the space has no place for are left out."""
        known, new = self._remembered(texts)
        if not new:
            return known
        with self._one_at_a_time:
            with suppress(TargetError):
                return known | self._embedded(new)
            for text in new:
                with suppress(TargetError):
                    known |= self._embedded([text])
        return known

    def _embedded(self, texts: Sequence[str]) -> dict[str, NDArray[np.float32]]:
        """By text, its vector, all in one batch. TargetError: one that the space has no place for."""
        rows = self._backend.embed_texts(texts) if texts else ()
        vectors = {text: row.copy() for text, row in zip(texts, rows, strict=True)}  # a view would keep the whole batch
        with self._lock:
            for text, vector in vectors.items():
                self._texts.put(text_key(text), vector, vector.nbytes)
        return vectors

    def _remembered(self, texts: Iterable[str]) -> tuple[dict[str, NDArray[np.float32]], list[str]]:
        """By text, the vectors that are kept; and the texts that have none, each once."""
        with self._lock:
            found = {text: self._texts.get(text_key(text)) for text in texts}
        known = {text: vector for text, vector in found.items() if vector is not None}
        return known, [text for text in found if text not in known]
