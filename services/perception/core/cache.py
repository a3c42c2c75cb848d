"""A cache bounded by bytes, and the keys of what is cached: hashes of content."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from typing import Generic, TypeVar

import msgspec

from surveilnav.messages import InferRequest, ModelIds

V = TypeVar("V")

_ENTRY_BYTES = 256  # approximate size of an entry beside its value


class ByteCache(Generic[V]):
    """The most recently used values, up to ``max_bytes`` in all; 0 caches nothing. Not thread-safe."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._bytes = 0
        self._entries: OrderedDict[bytes, tuple[V, int]] = OrderedDict()

    def get(self, key: bytes) -> V | None:
        """The cached value, which becomes the most recently used; None if there is none."""
        if key not in self._entries:
            return None
        self._entries.move_to_end(key)
        return self._entries[key][0]

    def put(self, key: bytes, value: V, n_bytes: int) -> None:
        """Caches a value of ``n_bytes`` and evicts the least recently used ones. A value that is too large isn't cached."""
        n_bytes += _ENTRY_BYTES
        if n_bytes > self._max_bytes:
            return
        if key in self._entries:
            self._bytes -= self._entries.pop(key)[1]
        self._entries[key] = value, n_bytes
        self._bytes += n_bytes
        while self._bytes > self._max_bytes:
            _, (_, evicted_bytes) = self._entries.popitem(last=False)
            self._bytes -= evicted_bytes


def content_key(request: InferRequest, payload: bytes, models: ModelIds, program: str = "") -> bytes:
    """Hash of all that a reply depends on: picture, depth, camera, prompts, models; not of who asks, or when.

    Backends that are told the truth have no such key: their replies depend on the view's name and on what they are told.

    Args:
        program: identifies the worker's program and settings, which are the same for all its requests.
    """
    digest = hashlib.blake2b(digest_size=16)
    inputs = (
        request.camera,
        request.image,
        request.depth,
        request.depth_range_m,
        request.prompts,
        request.detects,
        models,
        program,
    )
    digest.update(msgspec.msgpack.encode(inputs))
    digest.update(payload)
    return digest.digest()


def text_key(text: str) -> bytes:
    return hashlib.blake2b(text.encode(errors="surrogatepass"), digest_size=16).digest()
