"""The perception worker: pictures in, detections and embeddings out; texts in, embeddings out."""

from __future__ import annotations

import threading
import time

from services.perception.config import PerceptionSettings
from services.perception.truth_channel import TruthChannel
from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.contract import PERCEPTION_INFER, PERCEPTION_LOAD, PERCEPTION_TEXT
from surveilnav.errors import PerceptionError, TargetError, WireError
from surveilnav.messages import InferReply, InferRequest, TextReply, WorkerLoad
from surveilnav.perception import Backend
from surveilnav.sensing.packing import decode_rgbd, pack_embedding, perception_to_wire

MAX_TEXTS = 256


class PerceptionService:
    """Answers queries with a backend, one view at a time; says at 1 Hz how busy it is."""

    def __init__(self, node: Node, backend: Backend, settings: PerceptionSettings) -> None:
        self._node, self._backend, self._settings = node, backend, settings
        self._one_at_a_time, self._counting = threading.Lock(), threading.Lock()
        self._latency_ms = 0.0
        self._queued = 0
        self._last_load_s = 0.0
        self._truth = TruthChannel(node, backend.name, settings) if backend.needs_truth else None
        self._load = node.publisher(PERCEPTION_LOAD, worker=settings.worker)
        node.serve(PERCEPTION_LOAD, lambda _: Answer(self.load()), worker=settings.worker)
        node.serve(PERCEPTION_TEXT, self.embed_texts, worker=settings.worker)
        # A thread for everything that may wait, and one to refuse the next: so the queue can be counted.
        capacity = settings.capacity
        node.serve(PERCEPTION_INFER, self.infer, workers=capacity + 1, capacity=capacity, worker=settings.worker)

    def infer(self, query: Request) -> Answer:
        """Detections and embeddings of one view; refused as "busy" when as many wait as may."""
        with self._counting:
            if self._queued >= self._settings.capacity:
                raise Refused(
                    "busy", f"{self._queued} views are waiting already: ask again later or ask another worker"
                )
            self._queued += 1
        try:
            return self._infer(query)
        finally:
            with self._counting:
                self._queued -= 1

    def _infer(self, query: Request) -> Answer:
        request: InferRequest = query.message
        if request.camera is None or request.image is None or request.depth is None:
            raise WireError("a picture needs camera, image and depth in its request")
        key = (request.source, request.view, request.seq)
        truth = self._truth.wait_for(*key) if self._truth is not None else None
        with self._one_at_a_time:
            self._check_deadline(request, query)
            start = time.perf_counter()
            rgb, depth_m = decode_rgbd(
                query.payload, request.image, request.depth, request.camera, request.depth_range_m
            )
            try:
                seen = self._backend.perceive(
                    rgb, depth_m, request.camera, prompts=request.prompts, truth=truth, key=key
                )
            except PerceptionError as error:
                raise Refused("perception_failed", str(error)) from error
            detections, image_embedding = perception_to_wire(seen)
            latency_ms = self._count((time.perf_counter() - start) * 1e3)
        reply = InferReply(
            stamp_ns=clock_ns(), worker=self._settings.worker, backend=self._backend.name, source=request.source,
            view=request.view, seq=request.seq, detections=detections, image_embedding=image_embedding,
            latency_ms=latency_ms, models=self._backend.models, words=list(seen.words),
        )  # fmt: skip
        return Answer(reply)

    def _count(self, latency_ms: float) -> float:
        """Takes a view's time into the mean that it tells; returns it."""
        self._latency_ms = latency_ms if not self._latency_ms else 0.8 * self._latency_ms + 0.2 * latency_ms
        return latency_ms

    def embed_texts(self, query: Request) -> Answer:
        """Embeddings of texts."""
        request: InferRequest = query.message
        if not 1 <= len(request.texts) <= MAX_TEXTS or any(len(text) > 500 for text in request.texts):
            raise WireError(f"expected 1 to {MAX_TEXTS} texts of up to 500 characters, got {len(request.texts)}")
        try:
            rows = self._backend.embed_texts(request.texts)
        except TargetError as error:
            raise Refused("bad_target", str(error)) from error
        embeddings = [pack_embedding(row) for row in rows]
        name = self._backend.name
        return Answer(
            TextReply(
                stamp_ns=clock_ns(), worker=self._settings.worker, backend=name, embeddings=embeddings,
                models=self._backend.models,
            )
        )  # fmt: skip

    def step(self) -> bool:
        """Says once a second how busy it is."""
        now = time.monotonic()
        if now - self._last_load_s >= 1.0:
            self._last_load_s = now
            self._load.put(self.load())
        return False

    def load(self) -> WorkerLoad:
        """Queue and speed, and which backend runs."""
        return WorkerLoad(
            stamp_ns=clock_ns(), worker=self._settings.worker, backend=self._backend.name, why=self._backend.why,
            queued=self._queued, capacity=self._settings.capacity, latency_ms=self._latency_ms,
            models=self._backend.models, open_vocabulary=self._backend.vocabulary is None,
        )  # fmt: skip

    def _check_deadline(self, request: InferRequest, query: Request) -> None:
        late_ms = (clock_ns() - query.received_ns) / 1e6 - request.deadline_ms
        if late_ms >= 0:
            raise Refused(
                "too_late", f"the deadline of {request.deadline_ms} ms passed {late_ms:.0f} ms ago in the queue"
            )
