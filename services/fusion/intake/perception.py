"""Asks perception about views, off the main loop, until it answers: an outage delays views and loses none.

Robots and cameras have a thread each, so a robot waits for one camera's picture at most. One slot for every view:
a newer picture takes the place of one that still waits. Of the cameras' pictures that wait the one worth most comes next.
"""

from __future__ import annotations

import hashlib
import queue
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.bus import Node, Received, Refused, clock_ns
from surveilnav.contract import PERCEPTION_INFER, PERCEPTION_TEXT
from surveilnav.errors import BusError, PerceptionError, WireError
from surveilnav.messages import FrameHeader, InferReply, InferRequest, TextReply
from surveilnav.sensing.packing import decode_frame, perception_from_wire, unpack_embedding
from surveilnav.sensing.views import ViewPerception, looks_straight_down
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.intake.workers import Workers
from surveilnav.services.fusion.records import PerceivedView, ViewKey


class TextEmbedding(NamedTuple):
    """A text's unit vector (D,) float32, and the model that gave it."""

    vector: NDArray[np.float32]
    model: str


#: Refusals that have to do with the moment, not with the picture.
_PASSING = {"busy", "too_late", "no_truth", "not_ready", "superseded"}
_ATTEMPTS = 3  # at a picture that perception refuses for its own sake


@dataclass(slots=True)
class _Lane:
    """The waiting pictures of one kind of source, and the finished ones (few: decoded pictures are large)."""

    done: queue.Queue[PerceivedView]
    waiting: OrderedDict[ViewKey, Received[FrameHeader]] = field(default_factory=OrderedDict)
    problem: str = ""


class PerceptionClient:
    """Views in by ``submit``, out by ``robots`` and ``cameras``."""

    def __init__(
        self,
        node: Node,
        settings: FusionSettings,
        is_held: Callable[[ViewKey, bytes], bool],
        words: Callable[[], tuple[str, ...]],
        next_of: Callable[[Mapping[ViewKey, FrameHeader]], ViewKey],
    ) -> None:
        """``is_held``: whether the maps hold the picture of a camera's view with this digest. ``words``: what detectors
        with an open vocabulary should look for. Both are asked from any thread. ``next_of``: which of the cameras' waiting
        views comes next; asked by the thread that looks at them."""
        self._node, self._settings, self._searched = node, settings, words
        self._workers = Workers(node)
        self._lock = threading.Condition()
        self._robots = _Lane(queue.Queue(maxsize=8))
        self._cameras = _Lane(queue.Queue(maxsize=settings.camera_views_per_step))
        self._is_held, self._next_of = is_held, next_of
        self._texts: OrderedDict[tuple[str, str], TextEmbedding] = OrderedDict()
        for lane, name in ((self._robots, "robots"), (self._cameras, "cameras")):
            threading.Thread(target=self._work, args=(lane,), name=f"perception-{name}", daemon=True).start()

    @property
    def problem(self) -> str:
        """Why perception doesn't answer now; empty while it does."""
        return self._robots.problem or self._cameras.problem

    def words(self) -> tuple[str, ...]:
        """What is looked for now; nothing in particular where every worker knows a closed set of classes."""
        return self._searched() if self._workers.open_vocabulary else ()

    @property
    def embedder(self) -> str:
        """The model whose embeddings views get now; while no worker is there, the one of before. Workers of one building should
        run one."""
        return self._workers.embedder

    def submit(self, frame: Received[FrameHeader]) -> None:
        """Takes a picture in."""
        header = frame.message
        lane = self._robots if header.source.startswith("robot/") else self._cameras
        with self._lock:
            lane.waiting[header.source, header.view] = frame
            self._lock.notify_all()

    def look_again(self, frames: Iterable[Received[FrameHeader]]) -> None:
        """Takes in pictures of cameras that were looked at before, for other words; newer ones go before."""
        with self._lock:
            for frame in frames:
                self._cameras.waiting.setdefault((frame.message.source, frame.message.view), frame)
            self._lock.notify_all()

    def withdraw(self, source: str) -> None:
        """Forgets the waiting pictures of a source."""
        with self._lock:
            for lane in (self._robots, self._cameras):
                for key in [k for k in lane.waiting if k[0] == source]:
                    del lane.waiting[key]

    def robots(self) -> list[PerceivedView]:
        """All finished views of robots."""
        return _drained(self._robots.done, 1000)

    def cameras(self, most: int) -> list[PerceivedView]:
        """Up to ``most`` finished views of cameras."""
        return _drained(self._cameras.done, most)

    def text_embedding(self, text: str) -> TextEmbedding:
        """The embedding of a text, from memory where a worker of the same model gave it before.

        Raises:
            PerceptionError: no worker answers.
            Refused: the worker won't, e.g. because it doesn't know the class.
        """
        key = self.embedder, text
        with self._lock:
            if key in self._texts:
                return self._texts[key]
        request = InferRequest(stamp_ns=clock_ns(), texts=[text])
        reply: TextReply = self._workers.ask(PERCEPTION_TEXT, request, timeout_s=5.0, embedder=self.embedder).message
        if len(reply.embeddings) != 1:
            raise WireError(f"expected one embedding, got {len(reply.embeddings)}")
        embedding = TextEmbedding(unpack_embedding(reply.embeddings[0]), reply.models.embedder)
        with self._lock:
            self._texts[embedding.model, text] = embedding
            while len(self._texts) > 256:
                self._texts.popitem(last=False)
        return embedding

    def _work(self, lane: _Lane) -> None:
        while not self._node.stopping.is_set():
            with self._lock:
                if not lane.waiting:
                    self._lock.wait(timeout=0.2)
                    continue
            if (frame := self._taken_from(lane)) is None:
                continue
            try:
                finished = self._perceive(lane, frame)
            except WireError as error:
                self._node.reject("frame", f"{frame.message.source} view {frame.message.view}: {error}")
                header = frame.message
                finished = PerceivedView((header.source, header.view), header, fault=f"unreadable: {error}")
            except Exception as error:  # this thread is fusion's only pair of eyes on its lane
                self._node.warn_seldom("a view could not be perceived", error=f"{type(error).__name__}: {error}")
                self._node.stopping.wait(self._settings.retry_s)
                with self._lock:
                    lane.waiting.setdefault((frame.message.source, frame.message.view), frame)
                continue
            while finished is not None and not self._node.stopping.is_set():
                try:
                    lane.done.put(finished, timeout=0.2)
                    self._node.wake.set()
                    break
                except queue.Full:
                    continue

    def _taken_from(self, lane: _Lane) -> Received[FrameHeader] | None:
        """The next picture that waits: of robots by their turn, of cameras by worth; None if it was withdrawn meanwhile."""
        with self._lock:
            headers = {key: frame.message for key, frame in lane.waiting.items()}
        if not headers:
            return None
        key = self._next_of(headers) if lane is self._cameras and len(headers) > 1 else next(iter(headers))
        with self._lock:
            return lane.waiting.pop(key, None)

    def _perceive(self, lane: _Lane, frame: Received[FrameHeader]) -> PerceivedView | None:
        """Asks until there is an answer; None if a newer picture of the same view arrived meanwhile."""
        header, key = frame.message, (frame.message.source, frame.message.view)
        words = self.words()
        if self._is_held(key, _digest(frame, self.embedder, words)):
            return PerceivedView(key, header)
        view = decode_frame(header, frame.payload)
        reply, perception, attempts, embedder = b"", None, 0, self.embedder
        looks_down = looks_straight_down(view.T_world_camera)
        while not looks_down and attempts < _ATTEMPTS:
            pause_s, words = self._settings.retry_s, self.words()  # a mission may have begun meanwhile
            try:
                reply, perception = self._ask(frame, words)
                embedder = perception.embedding_model
                words = words if set(words) <= set(perception.words) else ()  # a closed set looked
                break
            except (Refused, WireError) as error:
                pause_s = _pause_s(error, pause_s)
                attempts += not _passes(error, lane is self._robots)
                if lane is self._robots:  # a camera's view that has to wait is no outage
                    lane.problem = f"perception can't tell what {header.source} sees: {error}"
            except (BusError, PerceptionError) as error:
                lane.problem = f"perception is down: {error}"
            self._node.wake.set()
            self._node.stopping.wait(pause_s)
            with self._lock:
                if self._node.stopping.is_set() or key in lane.waiting:
                    return None
        lane.problem = ""
        return PerceivedView(key, header, view, perception, frame.payload, reply, _digest(frame, embedder, words))

    def _ask(self, frame: Received[FrameHeader], words: tuple[str, ...]) -> tuple[bytes, ViewPerception]:
        """A worker's reply, as it was sent and as it is understood."""
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
    """Of a picture, its pose, the model that embeds it, and the words that it is looked at for."""
    header = frame.message
    said = repr((header.T_world_camera, header.camera, embedder, *words))
    digest = hashlib.blake2b(said.encode(), digest_size=16)
    digest.update(frame.payload)
    return digest.digest()


def _passes(error: Exception, is_robot: bool) -> bool:
    """Whether a refusal has to do with the moment. A robot says again what it sees, and the truth of it; a camera doesn't: a
    worker that was started after it will never be told."""
    return isinstance(error, Refused) and error.name in _PASSING and (is_robot or error.name != "no_truth")


def _pause_s(error: Exception, otherwise_s: float) -> float:
    """How long to wait before asking again: what a worker says, within reason."""
    said_ms = error.retry_after_ms if isinstance(error, Refused) else None
    return otherwise_s if said_ms is None else min(max(said_ms / 1000, 0.01), 10.0)


def _drained(finished: queue.Queue[PerceivedView], most: int) -> list[PerceivedView]:
    out: list[PerceivedView] = []
    while len(out) < most:
        try:
            out.append(finished.get_nowait())
        except queue.Empty:
            break
    return out
