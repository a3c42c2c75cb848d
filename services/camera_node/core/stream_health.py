"""What a camera's stream is doing: the watchdog's rules. Pure: every method gets the time.

States:
    connecting   no picture has come yet
    live         pictures come and change
    no_frames    no picture for ``NO_FRAMES_S``
    frozen       the same picture, bit by bit, for ``FROZEN_S``: a sensor's noise never repeats
    black        all pixels are dark: covered, or no light
    grey         all pixels are alike but not dark, as decoders show what they couldn't decode
    garbled      a large part of the picture is flat blocks, as after lost packets
    moved        its background is shifted: the camera was knocked or turned, and its calibration isn't true any more
    failed       the stream can't be opened or has ended; ``reason`` says why
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.messages.camera import StreamState

NO_FRAMES_S = 20.0
FROZEN_S = 20.0
#: A fault of the picture counts after this time, so that a flash or one lost packet doesn't.
_FAULT_S = 3.0
#: Pauses before another attempt, as Frigate and go2rtc make them; the last one from then on.
RECONNECT_AFTER_S = (1.0, 5.0, 10.0, 60.0)
#: After this time without a fault the pauses begin anew.
_STEADY_S = 60.0
_BLACK_MEAN, _FLAT_SPREAD = 16.0, 2.0
_BLOCK_PX, _MAX_FLAT_BLOCKS = 16, 0.4
#: States in which the connection itself may be at fault, so that it is made anew.
_RECONNECTS = ("no_frames", "frozen", "failed")


@dataclass(frozen=True, slots=True)
class FrameStatistics:
    """What the watchdog compares of a picture.

    Attributes:
        digest: of all pixels.
        mean, spread: mean and standard deviation of the brightness, 0-255.
        flat_blocks: share of the blocks of 16 x 16 pixels in which all pixels are alike, the dark and the bright ones left out.
    """

    digest: bytes
    mean: float
    spread: float
    flat_blocks: float

    @classmethod
    def from_picture(cls, rgb: NDArray[np.uint8]) -> FrameStatistics:
        """The statistics of a picture (height, width, 3)."""
        grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
        mean, spread = (float(v[0, 0]) for v in cv2.meanStdDev(grey))
        rows, cols = (n // _BLOCK_PX for n in grey.shape)
        flat = 0.0
        if rows and cols:
            blocks = grey[: rows * _BLOCK_PX, : cols * _BLOCK_PX].reshape(rows, _BLOCK_PX, cols, _BLOCK_PX)
            low, high = blocks.min((1, 3)), blocks.max((1, 3))
            flat = float(((low == high) & (low > 24) & (high < 232)).mean())
        return cls(hashlib.blake2b(rgb.tobytes(), digest_size=16).digest(), mean, spread, flat)

    @property
    def fault(self) -> Literal["", "black", "grey", "garbled"]:
        """What is wrong with the picture by itself."""
        if self.spread < _FLAT_SPREAD:
            return "black" if self.mean < _BLACK_MEAN else "grey"
        return "garbled" if self.flat_blocks > _MAX_FLAT_BLOCKS else ""


@dataclass(slots=True)
class StreamHealth:
    """Follows one stream.

    Attributes:
        state: see the module.
        reason: details, for people.
        since_s: when the state began.
        last_frame_s: when the last picture came; None: none has come.
        n_frames, n_reconnects: counts since the start.
    """

    state: StreamState = "connecting"
    reason: str = ""
    since_s: float = 0.0
    last_frame_s: float | None = None
    n_frames: int = 0
    n_reconnects: int = 0
    _opened_s: float = 0.0
    _digest: bytes = b""
    _digest_s: float = 0.0
    _fault: Literal["", "black", "grey", "garbled"] = ""
    _fault_s: float = 0.0
    _attempts: int = 0
    _lost: tuple[float, StreamState] | None = None
    _messages: list[str] = field(default_factory=list)

    @property
    def usable(self) -> bool:
        """Whether the newest picture shows the present."""
        return self.state == "live" and not self._fault

    def open(self, now_s: float) -> None:
        """The stream is being opened, or opened anew. What was wrong before stays as the reason until a picture comes."""
        if self.state != "connecting":
            self._attempts += 1
            self.n_reconnects += 1
            self.state, self.since_s = "connecting", now_s
        self._opened_s = now_s

    def frame(self, now_s: float, statistics: FrameStatistics, moved: str = "") -> None:
        """A picture has come. ``moved``: how its background is shifted, in words; empty: it isn't."""
        self.n_frames += 1
        self.last_frame_s = now_s
        if statistics.digest != self._digest:
            self._digest, self._digest_s = statistics.digest, now_s
        if statistics.fault != self._fault:
            self._fault, self._fault_s = statistics.fault, now_s
        if now_s - self._digest_s >= FROZEN_S:
            self._enter("frozen", now_s, f"the same picture for {now_s - self._digest_s:.0f} s")
        elif not self._fault:
            self._enter("moved" if moved else "live", now_s, moved)
        elif now_s - self._fault_s >= _FAULT_S:
            self._enter(self._fault, now_s, "its pictures show nothing")
        if self.state == "live" and now_s - self.since_s >= _STEADY_S:
            self._attempts = 0

    def failure(self, now_s: float, reason: str) -> None:
        """The stream couldn't be opened, or has ended."""
        self._enter("failed", now_s, reason)

    def tick(self, now_s: float) -> None:
        """Notices that no picture comes."""
        waited_s = now_s - max(self._opened_s, -1e18 if self.last_frame_s is None else self.last_frame_s)
        if self.state not in ("failed", "no_frames") and waited_s >= NO_FRAMES_S:
            self._enter("no_frames", now_s, f"no picture for {waited_s:.0f} s")

    def reconnect_due(self, now_s: float) -> bool:
        """Whether to open the stream anew now."""
        pause_s = RECONNECT_AFTER_S[min(self._attempts, len(RECONNECT_AFTER_S) - 1)]
        return self.state in _RECONNECTS and now_s - self.since_s >= pause_s

    def pop_messages(self) -> list[str]:
        """One line when the stream is lost, and one when it is back, since the last call."""
        messages, self._messages = self._messages, []
        return messages

    def _enter(self, state: StreamState, now_s: float, reason: str = "") -> None:
        self.reason = reason
        if state == self.state:
            return
        if state == "live":
            if self._lost is not None:
                lost_s, was = self._lost
                self._messages.append(f"the stream is back after {now_s - lost_s:.0f} s ({was})")
            self._lost = None
        elif self._lost is None:
            self._lost = now_s, state
            self._messages.append(f"the stream is lost: {state}{f', {reason}' if reason else ''}")
        self.state, self.since_s = state, now_s
