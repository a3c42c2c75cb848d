"""Sends a camera's views to whoever listens: each version once, in the tier and within the budget that the settings name, and no
faster than the link takes them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Literal

from surveilnav.bus import Node, clock_ns
from surveilnav.contract import CAMERA_FRAME
from surveilnav.errors import PerceptionError
from surveilnav.messages import PERCEIVED_TIERS, Tier, WaitReason
from surveilnav.services.camera_node import messages
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.core import sending
from surveilnav.services.camera_node.core.budget import TokenBucket, soon_bytes, tier_of, views_to_improve
from surveilnav.services.camera_node.core.link import Counts, Link
from surveilnav.services.camera_node.frames import EncodedFrame, FrameEncoder
from surveilnav.services.camera_node.own_perception import OwnPerception
from surveilnav.services.camera_node.sources.source import Source

#: Views that wait longer than this for the budget or the link are a problem that people should know of.
_LONG_WAIT_S = 10.0
#: So long the loop waits for the link at a time, and so often it looks meanwhile.
_LINK_WAIT_S, _LINK_POLL_S = 0.02, 0.002
#: Pause after the camera's own perception failed.
_RETRY_S = 60.0


class ViewSender:
    """Publishes the frames of one source.

    Attributes:
        encoder: encodes the frames; it makes thumbnails, too.
        sending: whether frames are being sent now; other work of the process should wait.
        order: in which what waits is sent, after what was asked for again; other views come last.
    """

    def __init__(
        self,
        node: Node,
        source: Source,
        settings: CameraSettings,
        own: OwnPerception | None,
        *,
        paused: Callable[[], bool],
    ) -> None:
        """``paused``: whether a person has paused the camera; asked before every frame."""
        self._paused = paused
        self._node, self._source, self._choice = node, source, settings.tier
        views, ids = range(len(source.views)), {"floor": source.place.floor, "camera": source.place.name}
        self._frames = {v: node.publisher(CAMERA_FRAME, **ids, view=v) for v in views}
        self.encoder = FrameEncoder(source, settings, own)
        self.sending = False
        self.order: Sequence[int] = ()
        self._seq = dict.fromkeys(views, 0)
        self._state = sending.SendState()
        self._tiers: dict[int, Tier] = {}
        self._sent_s: dict[int, float] = {}
        self._last_sent = -1
        self._pictures_wanted: set[int] = set()
        self._asked: set[int] = set()  # for again, and not sent yet
        self._features_bytes = (0, 0)  # how many frames, and their sum
        budget = settings.budget_kb_s
        self._bucket = TokenBucket.full(1000.0 * budget, time.monotonic()) if budget else None
        self._link = Link()
        self._asked_later_s: dict[int, float] = {}  # for what was under way then
        self._waiting: dict[int, int] = {}  # by view, the version that waits
        self._waits_since_s: dict[int, float] = {}
        self._why_waiting: WaitReason | Literal[""] = ""
        self._blind_until_s = 0.0

    @property
    def views(self) -> Collection[int]:
        return self._frames.keys()

    def want_pictures(self, views: Collection[int]) -> None:
        """Has these views sent with their pictures, as long as somebody listens to them."""
        self._pictures_wanted |= set(views)

    def step(self, asked_s: Mapping[int, float]) -> bool:
        """Sends the views that are due, as far as budget and link allow. True if any was sent.

        ``asked_s``: by view, when somebody asked for it again. Who asked before it arrived has it by now.
        """
        paused = self._paused()
        matched = {v for v, publisher in self._frames.items() if publisher.matched}
        versions = {v: version for v in self._frames if (version := self._source.version(v)) is not None}
        self._count_unsent(versions)
        self._asked = (self._asked | self._asked_again(asked_s)) & matched if not paused else set()
        self._pictures_wanted &= matched
        self._state, due = sending.views_to_send(
            self._state, versions=versions, matched=matched, requested=self._asked, paused=paused
        )
        self._tiers = {v: tier for v, tier in self._tiers.items() if v in self._state.sent}
        self._sent_s = {v: at_s for v, at_s in self._sent_s.items() if v in matched}
        better = {} if due else views_to_improve(self._choice, self._tiers, self._pictures_wanted, self._refilled())
        left = self._in_turn(due) if due else list(better)
        n, self.sending = len(left), bool(left)
        while left and self._may_send():
            tier = better.get(left[0]) or self._tier_of(left[0], len(left))
            if self._send(left[0], tier):
                self._asked.discard(left[0])
                del left[0]
        if due:
            self._state = self._state.without(left)
        self._waiting = {v: versions[v] for v in left if v in due}
        self._report_waiting()
        self.sending = False
        return len(left) < n

    def _asked_again(self, asked_s: Mapping[int, float]) -> set[int]:
        """Which views must be sent again. What is under way may still arrive: that is decided later."""
        is_under_way, waiting_s = self._is_under_way(), {**self._asked_later_s, **asked_s}
        self._asked_later_s = {v: at_s for v, at_s in waiting_s.items() if is_under_way and v == self._last_sent}
        lacks_picture = {v for v in self._pictures_wanted if self._tiers.get(v) in PERCEIVED_TIERS}
        missed = {v for v, at_s in waiting_s.items() if v in lacks_picture or self._sent_s.get(v, -math.inf) <= at_s}
        return missed - self._asked_later_s.keys()

    def _in_turn(self, due: Collection[int]) -> list[int]:
        """What was asked for again first, then what was sent longest ago, so that no view that changes often keeps others from
        being sent; among views that were never sent, as ``order`` has it."""
        place = {v: n for n, v in enumerate(self.order)}
        return sorted(due, key=lambda v: (v not in self._asked, self._sent_s.get(v, 0.0), place.get(v, len(place)), v))

    def _may_send(self) -> bool:
        bucket = self._refilled()
        if self._node.stopping.is_set() or self._paused() or not (bucket is None or bucket.allows):
            return False
        return self._link_is_free()

    def _link_is_free(self) -> bool:
        """Whether the frame before has arrived; waits for that a little."""
        until_s = time.monotonic() + _LINK_WAIT_S
        while self._is_under_way() or self._link.rests_until_s > time.monotonic():
            if time.monotonic() >= until_s or self._node.stopping.wait(_LINK_POLL_S):
                return False
        return True

    def _is_under_way(self) -> bool:
        """Whether the frame that was sent last hasn't arrived yet."""
        if self._link.frame is None:
            return False
        n_timed, now_s = self._link.n_timed, time.monotonic()
        self._link = self._link.at(now_s, self._counts())
        if self._link.n_timed > n_timed:
            self._sent_s[self._last_sent] = now_s
        return self._link.frame is not None

    def _counts(self) -> Counts | None:
        wire = self._node.wire_bytes()
        return wire and Counts(wire.acknowledged, wire.queued, wire.segment_bytes, wire.round_trip_s)

    def _refilled(self) -> TokenBucket | None:
        if self._bucket is not None:
            self._bucket = self._bucket.at(time.monotonic())
        return self._bucket

    def _tier_of(self, view: int, n_waiting: int) -> Tier:
        n, total = self._features_bytes
        return tier_of(
            self._choice,
            view,
            pictures_wanted=self._pictures_wanted,
            n_waiting=n_waiting,
            soon_bytes=soon_bytes(self._bucket, self._link),
            mean_bytes=total / n if n else 0.0,
        )

    def _send(self, view: int, tier: Tier) -> bool:
        """Encodes and sends a view; False if the camera was paused meanwhile."""
        frame = self._encoded(view, tier)
        if self._paused():
            return False
        self._seq[view] += 1
        header = messages.frame_header(self._source, view, self._seq[view], frame, now_ns=clock_ns())
        self._link = self._link.with_frame(len(frame.payload), time.monotonic(), self._counts())
        self._node.traffic.count_frame(frame.tier, self._frames[view].put(header, frame.payload))
        self._tiers[view], self._sent_s[view], self._last_sent = frame.tier, time.monotonic(), view
        if frame.tier == "features":
            n, total = self._features_bytes
            self._features_bytes = n + 1, total + len(frame.payload)
        if self._bucket is not None:
            self._bucket = self._bucket.without(len(frame.payload))
        return True

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

    def _count_unsent(self, versions: Mapping[int, int]) -> None:
        """Counts pictures that waited and that newer ones have replaced."""
        for view, version in self._waiting.items():
            if versions.get(view, version) != version:
                self._node.traffic.count_unsent(self._waits_for)

    @property
    def _waits_for(self) -> WaitReason:
        return "budget" if self._bucket is not None and not self._bucket.allows else "link"

    def _report_waiting(self) -> None:
        """Tells everybody if a view waits for the budget or the link for long, and for which."""
        now_s = time.monotonic()
        self._waits_since_s = {v: self._waits_since_s.get(v, now_s) for v in self._waiting}
        if now_s - min(self._waits_since_s.values(), default=now_s) < _LONG_WAIT_S:
            self._why_waiting = ""
        elif not self._why_waiting:
            self._why_waiting = self._waits_for
        for reason, too_small in (("budget", "its budget is too small"), ("link", "its link is too slow")):
            why = f"{too_small}: views wait for {_LONG_WAIT_S:g} s; a lower tier sends less"
            self._node.report_problem(reason, why if reason == self._why_waiting else "")
