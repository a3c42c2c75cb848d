"""Embeddings of texts, from perception or from a cache."""

from __future__ import annotations

import threading
from collections import OrderedDict
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surveilnav.bus import clock_ns
from surveilnav.contract import PERCEPTION_TEXT
from surveilnav.errors import WireError
from surveilnav.messages import InferRequest, TextReply
from surveilnav.sensing.packing import unpack_embedding
from surveilnav.services.fusion.intake.workers import Workers

_TIMEOUT_S = 5.0
_MAX_TEXTS = 256


class TextEmbedding(NamedTuple):
    """The unit vector (D,) float32 of a text, and the model that made it."""

    vector: NDArray[np.float32]
    model: str


class TextEncoder:
    """Has perception embed texts, and caches the newest embeddings. Safe from any thread."""

    def __init__(self, workers: Workers) -> None:
        self._workers = workers
        self._lock = threading.Lock()
        self._cache: OrderedDict[tuple[str, str], TextEmbedding] = OrderedDict()  # by model and text

    def encode(self, text: str) -> TextEmbedding:
        """The embedding of a text by the model that embeds views now.

        Raises:
            PerceptionError: no worker answers.
            Refused: the worker refuses, for example because it doesn't know the class.
        """
        model = self._workers.embedder
        with self._lock:
            if (model, text) in self._cache:
                return self._cache[model, text]
        request = InferRequest(stamp_ns=clock_ns(), texts=[text])
        reply: TextReply = self._workers.ask(PERCEPTION_TEXT, request, timeout_s=_TIMEOUT_S, embedder=model).message
        if len(reply.embeddings) != 1:
            raise WireError(f"expected one embedding, got {len(reply.embeddings)}")
        embedding = TextEmbedding(unpack_embedding(reply.embeddings[0]), reply.models.embedder)
        with self._lock:
            self._cache[embedding.model, text] = embedding
            while len(self._cache) > _MAX_TEXTS:
                self._cache.popitem(last=False)
        return embedding
