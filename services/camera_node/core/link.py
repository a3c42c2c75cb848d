"""What a camera's link takes: one frame at a time, and how fast.

A frame that waits in the kernel's buffers can't be overtaken by the answer to a request, grows old there, and is no longer the
newest picture when it arrives. So a camera gives the link its next frame once the router's side has acknowledged the one
before. On a fast link that takes a fraction of a millisecond. How long it takes on a slow one tells the link's rate.

After a frame that takes long the camera rests for as long. Otherwise the queues of a network that others share would never
empty, and their messages would be lost in them for seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

#: A frame that isn't in the kernel's buffers so long after it was sent isn't on its way any more: the bus has dropped it, or
#: the connection is a new one.
_LOST_S = 0.25
#: After a frame that took at least so long, the link rests for this share of the time, in which the network's queues empty.
_LONG_S, _REST = 0.1, 1.0
#: Weight of the newest frame in the measured rate.
_NEWEST = 0.3


class Counts(NamedTuple):
    """The kernel's counts of a connection, as in ``bus.traffic.WireBytes``."""

    acknowledged: int
    segment_bytes: int
    queued: int


class Frame(NamedTuple):
    """A frame of ``n_bytes`` that is under way since ``sent_s``; it has arrived once the kernel counts ``arrived_at_bytes``
    acknowledged ones."""

    n_bytes: int
    sent_s: float
    arrived_at_bytes: int


@dataclass(frozen=True, slots=True)
class Link:
    """What is known of a link. The kernel's counts are None where it can't be asked; then nothing is waited for.

    Attributes:
        frame: the frame that is under way; None: none is, and the next may be sent.
        rate_bytes_s: what it took of late; None: nobody has measured it yet.
        rests_until_s: before that nothing is sent.
    """

    frame: Frame | None = None
    rate_bytes_s: float | None = None
    rests_until_s: float = -math.inf

    def with_frame(self, n_bytes: int, now_s: float, before: Counts | None) -> Link:
        """The link when it is given a frame. ``before``: the kernel's counts just before.

        The frame's last packet needn't have been acknowledged, which the other side may put off.
        """
        if before is None:
            return self
        return replace(self, frame=Frame(n_bytes, now_s, before.acknowledged + n_bytes - before.segment_bytes))

    def at(self, now_s: float, counts: Counts | None) -> Link:
        """The link later, by the kernel's counts."""
        frame = self.frame
        if frame is None or counts is None:
            return replace(self, frame=None)
        took_s = now_s - frame.sent_s
        if counts.acknowledged >= frame.arrived_at_bytes:
            rate = frame.n_bytes / max(took_s, 1e-3)
            known = self.rate_bytes_s
            rest_s = _REST * took_s if took_s >= _LONG_S else 0.0
            return Link(None, rate if known is None else known + _NEWEST * (rate - known), now_s + rest_s)
        return replace(self, frame=None) if counts.queued == 0 and took_s >= _LOST_S else self
