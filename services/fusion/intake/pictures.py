"""The newest picture of each view of the invoked cameras, as it came: a new word costs no camera a byte."""

from __future__ import annotations

from collections import OrderedDict

from surveilnav.bus import Received
from surveilnav.messages import FrameHeader
from surveilnav.services.fusion.records import ViewKey


class KeptPictures:
    """Keeps up to ``most_bytes`` of them; the oldest go first."""

    def __init__(self, most_bytes: int) -> None:
        self._most_bytes, self._bytes = most_bytes, 0
        self._frames: OrderedDict[ViewKey, Received[FrameHeader]] = OrderedDict()

    def put(self, frame: Received[FrameHeader]) -> None:
        """Takes a camera's picture in, in the place of its former one; a robot's isn't kept."""
        if not frame.message.source.startswith("camera/"):
            return
        key = frame.message.source, frame.message.view
        self._drop(key)
        self._frames[key] = frame
        self._bytes += len(frame.payload)
        while self._bytes > self._most_bytes:
            self._drop(next(iter(self._frames)))

    def drop(self, source: str) -> None:
        """Forgets the pictures of a camera ("camera/<id>")."""
        for key in [key for key in self._frames if key[0] == source]:
            self._drop(key)

    def all(self) -> list[Received[FrameHeader]]:
        """All of them, the oldest first."""
        return list(self._frames.values())

    def _drop(self, key: ViewKey) -> None:
        if key in self._frames:
            self._bytes -= len(self._frames.pop(key).payload)
