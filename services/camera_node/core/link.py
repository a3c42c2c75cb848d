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
#: After a frame that took at least so long, the link rests for as long, but for no more than this.
_LONG_S, _MAX_REST_S = 0.1, 5.0
#: Whoever looks less often than this can't tell when a frame arrived.
_LOOK_S = 0.05
#: Weight of the newest frame in the measured rate.
_NEWEST = 0.3


class Counts(NamedTuple):
    """The kernel's counts of a connection, as in ``bus.traffic.WireBytes``."""

    acknowledged: int
    queued: int
    segment_bytes: int
    round_trip_s: float


class Frame(NamedTuple):
    """A frame of ``n_bytes`` that is under way since ``sent_s``; it has arrived once the kernel counts ``arrived_at_bytes``
    acknowledged ones. Somebody looked last at ``looked_s``."""

    n_bytes: int
    sent_s: float
    arrived_at_bytes: int
    looked_s: float


@dataclass(frozen=True, slots=True)
class Link:
    """What is known of a link. The kernel's counts are None where it can't be asked; then nothing is waited for.

    Attributes:
        frame: the frame that is under way; None: none is, and the next may be sent.
        rate_bytes_s: what it took of late; None: nobody has measured it yet.
        rests_until_s: before that nothing is sent.
        n_timed: how many frames arrived while somebody looked, so that it is known when.
    """

    frame: Frame | None = None
    rate_bytes_s: float | None = None
    rests_until_s: float = -math.inf
    n_timed: int = 0

    def with_frame(self, n_bytes: int, now_s: float, before: Counts | None) -> Link:
        """The link when it is given a frame. ``before``: the kernel's counts just before.

        The frame's last packet needn't have been acknowledged, which the other side may put off.
        """
        if before is None:
            return self
        arrived_at = before.acknowledged + before.queued + n_bytes - before.segment_bytes
        return replace(self, frame=Frame(n_bytes, now_s, arrived_at, now_s))

    def at(self, now_s: float, counts: Counts | None) -> Link:
        """The link later, by the kernel's counts. Call it often, as long as a frame is under way."""
        frame = self.frame
        if frame is None or counts is None:
            return replace(self, frame=None)
        if counts.acknowledged >= frame.arrived_at_bytes:
            return self._with_arrived(frame, now_s, counts)
        if counts.queued == 0 and now_s - frame.sent_s >= _LOST_S:
            return replace(self, frame=None)
        return replace(self, frame=frame._replace(looked_s=now_s))

    def _with_arrived(self, frame: Frame, now_s: float, counts: Counts) -> Link:
        """The link when a frame has arrived. A frame of one packet tells nothing of the rate, nor does one that arrived while
        nobody looked."""
        if frame.n_bytes <= counts.segment_bytes or now_s - frame.looked_s > _LOOK_S:
            return replace(self, frame=None)
        took_s = max(now_s - frame.sent_s - counts.round_trip_s, 1e-3)
        rate, known = frame.n_bytes / took_s, self.rate_bytes_s
        return Link(
            rate_bytes_s=rate if known is None else known + _NEWEST * (rate - known),
            rests_until_s=now_s + min(took_s, _MAX_REST_S) if took_s >= _LONG_S else -math.inf,
            n_timed=self.n_timed + 1,
        )
