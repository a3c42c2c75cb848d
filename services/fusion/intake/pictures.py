"""A cache of cameras' newest pictures, so that they can be perceived again for a new word without being sent again."""

from __future__ import annotations

from collections import OrderedDict

from surveilnav.bus import Received
from surveilnav.messages import FrameHeader
from surveilnav.services.fusion.perceived import ViewKey


class PictureCache:
    """Keeps up to ``max_bytes`` of cameras' frames. The oldest are dropped first."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes, self._bytes = max_bytes, 0
        self._frames: OrderedDict[ViewKey, Received[FrameHeader]] = OrderedDict()

    def put(self, frame: Received[FrameHeader]) -> None:
        """Adds a frame of a camera, in place of the previous one of that view. Frames of robots are ignored."""
        if not frame.message.source.startswith("camera/"):
            return
        key = frame.message.source, frame.message.view
        self._drop(key)
        self._frames[key] = frame
        self._bytes += len(frame.payload)
        while self._bytes > self._max_bytes:
            self._drop(next(iter(self._frames)))

    def drop_source(self, source: str) -> None:
        for key in [key for key in self._frames if key[0] == source]:
            self._drop(key)

    def frames(self) -> list[Received[FrameHeader]]:
        """All frames, the oldest first."""
        return list(self._frames.values())

    def _drop(self, key: ViewKey) -> None:
        if key in self._frames:
            self._bytes -= len(self._frames.pop(key).payload)
