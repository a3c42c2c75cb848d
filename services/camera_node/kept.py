"""What is made of a camera's views, kept between runs where its source knows what they show: a simulated building's."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from typing import TypeVar

import msgspec

from services.camera_node.config import CameraSettings
from services.camera_node.sources.source import Source
from surveilnav.config import cache_dir
from surveilnav.errors import ConfigError
from surveilnav.program import program_id
from surveilnav.stored import FolderCache

T = TypeVar("T")

_KIND = b"surveilnav camera 1"


class Kept:
    """The frames and looks of one source's views. All cameras share a folder."""

    def __init__(self, source: Source, settings: CameraSettings) -> None:
        self._source, self._room = source, settings.kept_mb * 1_000_000
        self._opened: FolderCache | None = None

    def key_of(self, view: int, how: str) -> str:
        """What something made of a view is kept under; empty: it isn't kept.

        Args:
            how: what is made, and all that it depends on beside the view and this program.
        """
        content = self._source.content(view) if self._room else ""
        if not content:
            return ""
        program = program_id("surveilnav", "services.camera_node")
        return hashlib.sha256(f"{content} {how} {program}".encode()).hexdigest()

    def get(self, key: str, of_parts: Callable[[Sequence[bytes]], T]) -> T | None:
        """What was made before; None: nothing, or nothing that ``of_parts`` can read."""
        files = self._files() if key else None
        parts = files.get(key) if files is not None else None
        if files is None or parts is None:
            return None
        try:
            return of_parts(parts)
        except (msgspec.DecodeError, ValueError, IndexError):
            files.drop(key)
            return None

    def put(self, key: str, view: int, how: str, parts: Sequence[bytes]) -> None:
        """Keeps what was made of a view, unless it shows something else by now. ``key``: from before it was looked at."""
        files = self._files() if key and key == self.key_of(view, how) else None
        if files is not None:
            files.put(key, parts)

    def _files(self) -> FolderCache | None:
        """The folder, opened when it is needed: a camera of which nothing is kept needs no cache."""
        if self._opened is None:
            try:
                self._opened = FolderCache(cache_dir() / "cameras", _KIND, ".kept", self._room)
            except ConfigError:
                return None
        return self._opened
