"""Results computed from a camera's views (encoded frames, detected labels), kept on disk between runs.

Only sources that can tell what a view shows without making it are cached: those of simulated buildings.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TypeVar

import msgspec

from surveilnav.code_fingerprint import code_fingerprint
from surveilnav.config import open_disk_cache
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.sources.source import Source
from surveilnav.storage import FolderCache

T = TypeVar("T")


class ResultCache:
    """The results of one source's views. All cameras share one folder on disk."""

    def __init__(self, source: Source, settings: CameraSettings) -> None:
        self._source, self._max_mb = source, settings.disk_cache_mb

    def key_for(self, view: int, recipe: str) -> str:
        """The cache key of a result; empty if it can't be cached.

        Args:
            recipe: what is computed, and all that it depends on besides the view's content and this program.
        """
        content = self._source.content(view) if self._max_mb else ""
        if not content:
            return ""
        program = code_fingerprint("surveilnav", "surveilnav.services.camera_node")
        return hashlib.sha256(f"{content} {recipe} {program}".encode()).hexdigest()

    def get(self, key: str, parse: Callable[[Sequence[bytes]], T]) -> T | None:
        """The cached result; None if there is none, or none that ``parse`` can read."""
        if not key or self._folder is None:
            return None
        return self._folder.read(key, parse, msgspec.DecodeError, ValueError, IndexError)

    def put(self, key: str, view: int, recipe: str, parts: Sequence[bytes]) -> None:
        """Stores a result under the ``key`` that was made before the picture was taken.

        Nothing is stored if the view has changed since: the picture may belong to either content.
        """
        if key and key == self.key_for(view, recipe) and self._folder is not None:
            self._folder.put(key, parts)

    @cached_property
    def _folder(self) -> FolderCache | None:
        """Opened at the first use, so that a camera without anything to cache creates no folder."""
        return open_disk_cache("cameras", b"surveilnav camera 1", self._max_mb)
