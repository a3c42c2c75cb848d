"""What was answered before, by the hash of what was asked, up to so many bytes."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from typing import Generic, TypeVar

import msgspec

from surveilnav.messages import InferRequest, ModelIds
from surveilnav.services.perception.core.answer import Known, of_bytes

V = TypeVar("V")

_ENTRY_BYTES = 256  # what an entry takes beside its value: about


class ByteCache(Generic[V]):
    """The values used last, up to ``max_bytes`` of them; 0 keeps none. Not for several threads at a time."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._bytes = 0
        self._kept: OrderedDict[bytes, tuple[V, int]] = OrderedDict()

    def get(self, key: bytes) -> V | None:
        """The value kept for a key; it counts as used."""
        if key not in self._kept:
            return None
        self._kept.move_to_end(key)
        return self._kept[key][0]

    def put(self, key: bytes, value: V, n_bytes: int) -> None:
        """Keeps a value that takes ``n_bytes``, and lets go of what was used longest ago; one that is too large isn't kept."""
        n_bytes += _ENTRY_BYTES
        if n_bytes > self._max_bytes:
            return
        if key in self._kept:
            self._bytes -= self._kept.pop(key)[1]
        self._kept[key] = value, n_bytes
        self._bytes += n_bytes
        while self._bytes > self._max_bytes:
            _, (_, gone) = self._kept.popitem(last=False)
            self._bytes -= gone


class AnswerCache:
    """The answers used last, up to ``max_bytes``. Kept as bytes: decoded, a mask takes several times as much."""

    def __init__(self, max_bytes: int) -> None:
        self._kept: ByteCache[bytes] = ByteCache(max_bytes)

    def get(self, key: bytes) -> Known | None:
        """The answer kept for a key; it counts as used."""
        known = self._kept.get(key)
        return of_bytes(known) if known is not None else None

    def put(self, key: bytes, answer: bytes) -> None:
        """Keeps an answer (``to_bytes``), and lets go of what was used longest ago."""
        self._kept.put(key, answer, len(answer))


def content_key(request: InferRequest, payload: bytes, models: ModelIds, program: str = "") -> bytes:
    """The hash of all that an answer depends on: picture, depth, camera, prompts, models. Not who asks, nor when.

    ``program``: what a worker is beside its models, the same for all that it is asked.

    A backend that is told the truth has no such key: it answers by the view's name and by what it was told.
    """
    digest = hashlib.blake2b(digest_size=16)
    asked = (
        request.camera,
        request.image,
        request.depth,
        request.depth_range_m,
        request.prompts,
        request.detects,
        models,
        program,
    )
    digest.update(msgspec.msgpack.encode(asked))
    digest.update(payload)
    return digest.digest()


def text_key(text: str) -> bytes:
    """The hash of a text."""
    return hashlib.blake2b(text.encode(errors="surrogatepass"), digest_size=16).digest()
