"""The interface of those who read pictures from a stream."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from surveilnav.messages import CaptureClock


class StreamError(Exception):
    """A stream can't be opened or has ended. The message never holds the address, which may have a password in it."""


@dataclass(frozen=True, slots=True, eq=False)
class CapturedFrame:
    """A picture as it came: (height, width, 3) uint8, with its time of capture [ns since 1970]."""

    rgb: NDArray[np.uint8]
    captured_ns: int
    clock: CaptureClock


class FrameReader(Protocol):
    """Reads one stream, on one thread.

    Attributes:
        bytes_read: bytes that have come in from the camera; 0 if that isn't known.
    """

    bytes_read: int

    def open(self) -> None:
        """Opens the stream. Raises StreamError if that fails."""
        ...

    def read(self) -> CapturedFrame | None:
        """Waits for the next picture; None if none has come within a second or so, and to ask again makes sense.

        Raises:
            StreamError: the stream has ended or failed.
        """
        ...

    def close(self) -> None:
        """Closes the stream, on the thread that reads it."""
        ...
