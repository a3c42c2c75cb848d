"""What is made of a camera's views, kept between runs where its source knows what they show: a simulated building's."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TypeVar

import msgspec

from surveilnav.config import cache_called
from surveilnav.program import program_id
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.sources.source import Source
from surveilnav.stored import FolderCache

T = TypeVar("T")


class Kept:
    """The frames and looks of one source's views. All cameras share a folder."""

    def __init__(self, source: Source, settings: CameraSettings) -> None:
        self._source, self._max_mb = source, settings.kept_mb

    def key_of(self, view: int, how: str) -> str:
        """What something made of a view is kept under; empty: it isn't kept.

        Args:
            how: what is made, and all that it depends on beside the view and this program.
        """
        content = self._source.content(view) if self._max_mb else ""
        if not content:
            return ""
        program = program_id("surveilnav", "surveilnav.services.camera_node")
        return hashlib.sha256(f"{content} {how} {program}".encode()).hexdigest()

    def get(self, key: str, of_parts: Callable[[Sequence[bytes]], T]) -> T | None:
        """What was made before; None: nothing, or nothing that ``of_parts`` can read."""
        if not key or self._files is None:
            return None
        return self._files.read(key, of_parts, msgspec.DecodeError, ValueError, IndexError)

    def put(self, key: str, view: int, how: str, parts: Sequence[bytes]) -> None:
        """Keeps what was made of a view, unless it shows something else by now. ``key``: from before it was looked at."""
        if key and key == self.key_of(view, how) and self._files is not None:
            self._files.put(key, parts)

    @cached_property
    def _files(self) -> FolderCache | None:
        """The folder, opened when it is needed: a camera of which nothing is kept needs no cache."""
        return cache_called("cameras", b"surveilnav camera 1", self._max_mb)
