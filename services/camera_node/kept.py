"""What is made of a camera's views, kept between runs where its source knows what they show: a simulated building's."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from services.camera_node.config import CameraSettings
from services.camera_node.sources.source import Source
from surveilnav.config import cache_dir
from surveilnav.stored import FolderCache

_KIND = b"surveilnav camera 1"


class Kept:
    """The frames and looks of one source's views. All cameras share a folder."""

    def __init__(self, source: Source, settings: CameraSettings) -> None:
        self._source, room = source, settings.kept_mb * 1_000_000
        self._files = FolderCache(cache_dir() / "cameras", _KIND, ".kept", room) if room else None

    def get(self, view: int, how: str) -> list[bytes] | None:
        """What was made of a view before; None: nothing. ``how``: what it is, and all that it depends on beside the view."""
        key = self._key(view, how)
        return self._files.get(key) if self._files is not None and key else None

    def put(self, view: int, how: str, parts: Sequence[bytes]) -> None:
        """Keeps what was made of a view, where anybody can know later that it is the same view."""
        key = self._key(view, how)
        if self._files is not None and key:
            self._files.put(key, parts)

    def _key(self, view: int, how: str) -> str:
        content = self._source.content(view)
        return hashlib.sha256(f"{content} {how}".encode()).hexdigest() if content else ""
