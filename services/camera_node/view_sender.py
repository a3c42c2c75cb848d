"""Sends a camera's views to whoever listens: each version once, in the tier and within the budget that the settings name."""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from typing import Any

from surveilnav.bus import Node, clock_ns
from surveilnav.contract import CAMERA_FRAME, TRUTH
from surveilnav.errors import PerceptionError
from surveilnav.messages import PERCEIVED_TIERS, Tier
from surveilnav.sensing.truth import truth_to_wire
from surveilnav.services.camera_node import messages
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.core import sending
from surveilnav.services.camera_node.core.budget import TokenBucket, tier_of, views_to_improve
from surveilnav.services.camera_node.frames import EncodedFrame, FrameEncoder
from surveilnav.services.camera_node.own_perception import OwnPerception
from surveilnav.services.camera_node.sources.source import Source

#: Views that wait longer than this for the budget are a problem that people should know of.
_LONG_WAIT_S = 10.0
#: Pause after the camera's own perception failed.
_RETRY_S = 60.0


class ViewSender:
    """Publishes the frames of one source.

    Attributes:
        encoder: encodes the frames; it makes thumbnails, too.
        sending: whether frames are being sent now; other work of the process should wait.
        order: in which what waits is sent, after what was asked for again; other views come last.
    """

    def __init__(self, node: Node, source: Source, settings: CameraSettings, own: OwnPerception | None) -> None:
        self._node, self._source, self._choice = node, source, settings.tier
        views, ids = range(len(source.views)), {"floor": source.place.floor, "camera": source.place.name}
        self._frames = {v: node.publisher(CAMERA_FRAME, **ids, view=v) for v in views}
        self._truths = {v: node.publisher(TRUTH, source=f"camera-{source.place.name}", view=v) for v in views}
        self.encoder = FrameEncoder(source, settings, own)
        self.sending = False
        self.order: Sequence[int] = ()
        self._seq = dict.fromkeys(views, 0)
        self._state = sending.SendState()
        self._tiers: dict[int, Tier] = {}
        self._whole: set[int] = set()
        self._asked: set[int] = set()  # for again, and not sent yet
        self._features_bytes = (0, 0)  # how many frames, and their sum
        budget = settings.budget_kb_s
        self._bucket = TokenBucket.full(1000.0 * budget, time.monotonic()) if budget else None
        self._waits_since_s: float | None = None
        self._blind_until_s = 0.0

    @property
    def views(self) -> Collection[int]:
        return self._frames.keys()

    def want_pictures(self, views: Collection[int]) -> None:
        """Has these views sent with their pictures, as long as somebody listens to them."""
        self._whole |= set(views)

    def step(self, requested: Collection[int], *, paused: bool) -> bool:
        """Sends the views that are due, as far as the budget allows. True if there were any."""
        matched = {v for v, publisher in self._frames.items() if publisher.matched}
        versions = {v: version for v in self._frames if (version := self._source.version(v)) is not None}
        self._asked = (self._asked | set(requested)) & matched if not paused else set()
        self._whole &= matched
        self._state, due = sending.views_to_send(
            self._state, versions=versions, matched=matched, requested=self._asked, paused=paused
        )
        self._tiers = {v: tier for v, tier in self._tiers.items() if v in self._state.sent}
        due = due or views_to_improve(self._choice, self._tiers, self._whole, self._refilled())
        self.sending = bool(due)
        place = {v: n for n, v in enumerate(self.order)}
        left = sorted(due, key=lambda v: (v not in self._asked, place.get(v, len(place))))  # stable
        while left and not self._node.stopping.is_set():
            bucket = self._refilled()
            if bucket is not None and not bucket.allows:
                break
            self._send(left[0], len(left))
            self._asked.discard(left.pop(0))
        self._state = self._state.without(left)
        self._report_waiting(len(left))
        self.sending = False
        return len(left) < len(due)

    def _refilled(self) -> TokenBucket | None:
        if self._bucket is not None:
            self._bucket = self._bucket.at(time.monotonic())
        return self._bucket

    def _send(self, view: int, n_waiting: int) -> None:
        n, total = self._features_bytes
        tier = tier_of(
            self._choice,
            view,
            whole=self._whole,
            n_waiting=n_waiting,
            bucket=self._bucket,
            mean_bytes=total / n if n else 0.0,
        )
        frame = self._encoded(view, tier)
        self._seq[view] += 1
        self._send_truth(view, frame.version)
        header = messages.frame_header(self._source, view, self._seq[view], frame, now_ns=clock_ns())
        self._frames[view].put(header, frame.payload)
        self._tiers[view] = frame.tier
        if frame.tier == "features":
            self._features_bytes = n + 1, total + len(frame.payload)
        if self._bucket is not None:
            self._bucket = self._bucket.without(len(frame.payload))

    def _encoded(self, view: int, tier: Tier) -> EncodedFrame:
        """The newest picture of a view in a tier; with all of it if the camera's own perception fails."""
        if tier in PERCEIVED_TIERS and time.monotonic() >= self._blind_until_s:
            try:
                return self.encoder.newest(view, tier)
            except PerceptionError as error:
                self._blind_until_s = time.monotonic() + _RETRY_S
                self._node.traffic.reject("own perception")
                self._node.log.warning("the camera can't look by itself, and sends pictures", error=str(error))
        return self.encoder.newest(view, "jpeg+depth" if tier in PERCEIVED_TIERS else tier)

    def _send_truth(self, view: int, version: int) -> None:
        """Publishes the instance ids of a simulated view, to which only the backends oracle and simulated ever listen."""
        if not self._truths[view].matched:
            return
        picture = self._source.latest(view)
        if picture.truth is None or picture.version != version:
            return
        source: Any = f"camera/{self._source.place.name}"
        truth = truth_to_wire(picture.truth, source=source, view=view, seq=self._seq[view], stamp_ns=clock_ns())
        self._truths[view].put(*truth)

    def _report_waiting(self, n: int) -> None:
        """Tells everybody if views wait for the budget for long."""
        now_s = time.monotonic()
        self._waits_since_s = None if not n else self._waits_since_s or now_s
        if self._waits_since_s is None or self._bucket is None:
            self._node.report_problem("budget", "")
        elif now_s - self._waits_since_s >= _LONG_WAIT_S:
            rate = self._bucket.rate_bytes_s / 1000
            self._node.report_problem(
                "budget", f"its budget of {rate:g} kB/s is too small: views wait for {_LONG_WAIT_S:g} s"
            )
