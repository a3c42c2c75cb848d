"""Sends views to perception, on threads beside the main loop, and repeats each until it is answered.

So an outage of perception delays views but loses none. Robots and cameras have a lane each, with its own thread, so that a
robot's view never waits behind cameras' views. A lane holds at most one picture per view: a newer one replaces one that still
waits. In the lane of cameras, the most useful picture is perceived first (``ranking``).
"""

from __future__ import annotations

import hashlib
import queue
import threading
from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass, field

import msgspec

from surveilnav.bus import Node, Received, Refused, bound_request_id, clock_ns
from surveilnav.contract import PERCEPTION_INFER
from surveilnav.errors import BusError, PerceptionError, WireError
from surveilnav.messages import PERCEIVED_TIERS, FrameHeader, InferReply, InferRequest
from surveilnav.sensing.packing import decode_frame
from surveilnav.sensing.perceived import perceived_reply
from surveilnav.sensing.replies import perception_from_wire
from surveilnav.sensing.views import PosedView, ViewPerception, looks_straight_down
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.intake.ranking import ViewRanking
from surveilnav.services.fusion.intake.wanted_pictures import WantedPictures
from surveilnav.services.fusion.intake.words import SearchedWords
from surveilnav.services.fusion.intake.workers import Workers
from surveilnav.services.fusion.map_log.removal import Removal
from surveilnav.services.fusion.perceived import PerceivedView, ViewKey

#: Source, view, number and stamp of a frame.
FrameId = tuple[str, int, int, int]
#: Refusals for reasons that pass, and have nothing to do with the picture.
_TRANSIENT = {"busy", "too_late", "no_truth", "not_ready", "superseded"}
_MAX_ATTEMPTS = 3  # with a picture that perception refuses for a reason that doesn't pass


@dataclass(slots=True)
class _Lane:
    """The waiting and the finished pictures of one kind of source. ``done`` has few, since decoded pictures are large.

    ``active`` is the header of the view that is being perceived, or that waits for room in ``done``.
    """

    done: queue.Queue[PerceivedView]
    active: FrameHeader | None = None
    waiting: OrderedDict[ViewKey, Received[FrameHeader]] = field(default_factory=OrderedDict)
    problem: str = ""


class PerceptionClient:
    """Perceives frames: ``submit`` takes them, ``pop_robots`` and ``pop_cameras`` return them as perceived views."""

    def __init__(
        self,
        node: Node,
        settings: FusionSettings,
        workers: Workers,
        maps: BuildingMaps,
        words: SearchedWords,
        ranking: ViewRanking,
        wanted: WantedPictures,
    ) -> None:
        self._wanted_pictures = wanted
        self._node, self._settings, self._workers = node, settings, workers
        self._maps, self._searched, self._ranking = maps, words, ranking
        self._lock = threading.Condition()
        self._withdrawn: set[FrameId] = set()  # frames that are still under way and that nobody wants any more
        self._robots = _Lane(queue.Queue(maxsize=8))
        self._cameras = _Lane(queue.Queue(maxsize=settings.camera_views_per_step))
        for lane, name in ((self._robots, "robots"), (self._cameras, "cameras")):
            threading.Thread(target=self._work, args=(lane,), name=f"perception-{name}", daemon=True).start()

    @property
    def problem(self) -> str:
        """Why perception doesn't answer at the moment; "" while it does."""
        return self._robots.problem or self._cameras.problem

    def words(self) -> tuple[str, ...]:
        """The words that perception is to look for now; none if every worker has a closed vocabulary."""
        return self._searched.current() if self._workers.open_vocabulary else ()

    def submit(self, frame: Received[FrameHeader]) -> None:
        """Queues a frame. It replaces an older one of the same view that still waits."""
        header = frame.message
        lane = self._robots if header.source.startswith("robot/") else self._cameras
        with self._lock:
            lane.waiting[header.source, header.view] = frame
            self._lock.notify_all()

    def resubmit(self, frames: Iterable[Received[FrameHeader]]) -> None:
        """Queues frames of cameras to be perceived again, unless a newer one of the same view waits."""
        with self._lock:
            for frame in frames:
                self._cameras.waiting.setdefault((frame.message.source, frame.message.view), frame)
            self._lock.notify_all()

    def withdraw(self, source: str) -> None:
        with self._lock:
            for lane in (self._robots, self._cameras):
                for key in [k for k in lane.waiting if k[0] == source]:
                    del lane.waiting[key]

    def withdraw_removed(self, removal: Removal) -> None:
        """Drops all views that a removal takes away, also those that are being perceived or are ready."""
        with self._lock:
            for lane in (self._robots, self._cameras):
                waiting = [(key, frame.message) for key, frame in lane.waiting.items()]
                for key in [key for key, header in waiting if removal.includes(header.source, header.stamp_ns)]:
                    del lane.waiting[key]
                under_way = [view.header for view in list(lane.done.queue)]
                under_way += [lane.active] if lane.active is not None else []
                self._withdrawn |= {_frame_id(h) for h in under_way if removal.includes(h.source, h.stamp_ns)}

    def has_views_of(self, source: str) -> bool:
        """Whether a view of a source waits, is being perceived, or has yet to be popped."""
        with self._lock:
            lanes = self._robots, self._cameras
            sources = [key[0] for lane in lanes for key in lane.waiting]
            sources += [lane.active.source for lane in lanes if lane.active is not None]
            sources += [view.key[0] for lane in lanes for view in list(lane.done.queue)]
        return source in sources

    def pop_robots(self) -> list[PerceivedView]:
        return self._wanted(_drain(self._robots.done, 1000))

    def pop_cameras(self, max_views: int) -> list[PerceivedView]:
        """Up to ``max_views`` perceived views of cameras."""
        return self._wanted(_drain(self._cameras.done, max_views))

    def _wanted(self, views: list[PerceivedView]) -> list[PerceivedView]:
        """Those of the views that weren't withdrawn meanwhile."""
        if not self._withdrawn:
            return views
        with self._lock:
            wanted = [view for view in views if _frame_id(view.header) not in self._withdrawn]
            self._withdrawn -= {_frame_id(view.header) for view in views}
        return wanted

    def _work(self, lane: _Lane) -> None:
        while not self._node.stopping.is_set():
            with self._lock:
                if not lane.waiting:
                    self._lock.wait(timeout=0.2)
                    continue
            frame = self._next_frame(lane)
            if frame is not None:
                with bound_request_id(frame.request_id):
                    finished = self._try_to_perceive(lane, frame)
                if finished is not None:
                    self._deliver(lane, finished)
            lane.active = None

    def _try_to_perceive(self, lane: _Lane, frame: Received[FrameHeader]) -> PerceivedView | None:
        """Calls ``_perceive`` and catches every exception, because no other thread serves this lane."""
        header = frame.message
        try:
            return self._perceive(lane, frame)
        except WireError as error:
            self._node.reject("frame", f"{header.source} view {header.view}: {error}")
            key, fault = (header.source, header.view), f"unreadable: {error}"
            return PerceivedView(key, header, fault=fault, request_id=frame.request_id)
        except Exception as error:
            self._node.warn_seldom("a view could not be perceived", error=f"{type(error).__name__}: {error}")
            self._node.stopping.wait(self._settings.retry_s)
            with self._lock:
                lane.waiting.setdefault((header.source, header.view), frame)
            return None

    def _deliver(self, lane: _Lane, finished: PerceivedView) -> None:
        """Puts a finished view into its queue, and waits while that is full."""
        while not self._node.stopping.is_set():
            try:
                lane.done.put(finished, timeout=0.2)
                self._node.wake.set()
                return
            except queue.Full:
                continue

    def _next_frame(self, lane: _Lane) -> Received[FrameHeader] | None:
        """Takes the next waiting frame: the oldest of robots, the most useful of cameras. None if it was withdrawn meanwhile."""
        with self._lock:
            headers = {key: frame.message for key, frame in lane.waiting.items()}
        if not headers:
            return None
        is_ranked = lane is self._cameras and len(headers) > 1
        key = self._ranking.pop_best(headers) if is_ranked else next(iter(headers))
        with self._lock:
            frame = lane.waiting.pop(key, None)
            lane.active = frame.message if frame is not None else None
            return frame

    def _perceive(self, lane: _Lane, frame: Received[FrameHeader]) -> PerceivedView | None:
        """Sends a frame to perception until it answers; None if a newer picture of the same view arrives meanwhile."""
        header, key = frame.message, (frame.message.source, frame.message.view)
        words = self.words()
        if self._maps.processed.contains(key, _digest(frame, self._workers.embedder, words)):
            return PerceivedView(key, header, request_id=frame.request_id)
        view = decode_frame(header, frame.payload)
        if header.tier in PERCEIVED_TIERS:
            return self._perceived_by_camera(frame, view, words)
        reply, perception, attempts, embedder = b"", None, 0, self._workers.embedder
        looks_down = looks_straight_down(view.T_world_camera)
        while not looks_down and attempts < _MAX_ATTEMPTS:
            pause_s, words = self._settings.retry_s, self.words()  # a mission may have started meanwhile
            try:
                reply, perception = self._ask(frame, words)
                embedder = perception.embedding_model
                words = (
                    words if set(words) <= set(perception.words) else ()
                )  # a worker with a closed vocabulary has answered
                break
            except (Refused, WireError) as error:
                pause_s = _pause_s(error, pause_s)
                attempts += not _is_transient(error, lane is self._robots)
                if attempts == _MAX_ATTEMPTS:
                    why = f"the maps take it without detections, because perception can't tell: {error}"
                    self._node.reject("view.not_perceived", f"{header.source} view {header.view}: {why}")
                if lane is self._robots:  # a camera's view may wait, which is no outage
                    lane.problem = f"perception can't tell what {header.source} sees: {error}"
            except (BusError, PerceptionError) as error:
                lane.problem = f"perception is down: {error}"
            self._node.wake.set()
            self._node.stopping.wait(pause_s)
            with self._lock:
                if self._node.stopping.is_set() or key in lane.waiting:
                    return None
        lane.problem = ""
        digest = _digest(frame, embedder, words)
        return PerceivedView(key, header, view, perception, frame.payload, reply, digest, request_id=frame.request_id)

    def _perceived_by_camera(
        self, frame: Received[FrameHeader], view: PosedView, words: tuple[str, ...]
    ) -> PerceivedView:
        """A frame of a camera that looks by itself. Its pictures are wanted, too, if it didn't look for what is searched."""
        header, key, perception = frame.message, (frame.message.source, frame.message.view), None
        reply = perceived_reply(header, frame.payload)
        if reply is not None:
            perception = perception_from_wire(reply, header.camera)
            self._wanted_pictures.looked(key, perception.words)
        raw = msgspec.msgpack.encode(reply) if reply is not None else b""
        digest = _digest(frame, self._workers.embedder, words)
        return PerceivedView(key, header, view, perception, frame.payload, raw, digest, request_id=frame.request_id)

    def _ask(self, frame: Received[FrameHeader], words: tuple[str, ...]) -> tuple[bytes, ViewPerception]:
        """Asks a worker about a frame; returns its reply, as bytes and decoded."""
        header, timeout_s = frame.message, self._settings.infer_timeout_s
        request = InferRequest(
            stamp_ns=clock_ns(),
            source=header.source,
            view=header.view,
            seq=header.seq,
            camera=header.camera,
            image=header.image,
            depth=header.depth,
            depth_range_m=header.depth_range_m,
            depth_source=header.depth_source,
            prompts=list(words),
            detects=bool(words) or not self._workers.needs_words,
            deadline_ms=int(900 * timeout_s),
            asker=self._node.id,
        )
        reply: InferReply = self._workers.ask(PERCEPTION_INFER, request, frame.payload, timeout_s=timeout_s).message
        if (reply.source, reply.view, reply.seq) != (header.source, header.view, header.seq):
            raise WireError(f"worker {reply.worker} answered about another view")
        return msgspec.msgpack.encode(reply), perception_from_wire(reply, header.camera)


def _digest(frame: Received[FrameHeader], embedder: str, words: tuple[str, ...]) -> bytes:
    """Hash of a picture, its pose and intrinsics, the model that embeds it, and the words that are looked for in it."""
    header = frame.message
    metadata = repr((header.T_world_camera, header.camera, embedder, *words))
    digest = hashlib.blake2b(metadata.encode(), digest_size=16)
    digest.update(frame.payload)
    return digest.digest()


def _frame_id(header: FrameHeader) -> FrameId:
    return header.source, header.view, header.seq, header.stamp_ns


def _is_transient(error: Exception, is_robot: bool) -> bool:
    """Whether a request was refused for a reason that passes, so that sending it again helps.

    A camera of which a simulator doesn't tell the truth (``no_truth``) is gone or real, and must not hold up the others. A robot
    is worth waiting for: it may be starting again.
    """
    return isinstance(error, Refused) and error.name in _TRANSIENT and (is_robot or error.name != "no_truth")


def _pause_s(error: Exception, otherwise_s: float) -> float:
    """How long to wait before sending a request again: what the worker asks for, within limits, or ``otherwise_s``."""
    retry_ms = error.retry_after_ms if isinstance(error, Refused) else None
    return otherwise_s if retry_ms is None else min(max(retry_ms / 1000, 0.01), 10.0)


def _drain(finished: queue.Queue[PerceivedView], max_views: int) -> list[PerceivedView]:
    out: list[PerceivedView] = []
    while len(out) < max_views:
        try:
            out.append(finished.get_nowait())
        except queue.Empty:
            break
    return out
