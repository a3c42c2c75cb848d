"""The perception worker: answers requests for detections and embeddings of views, and for embeddings of texts."""

from __future__ import annotations

import time
from concurrent.futures import Future
from typing import Any

from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.contract import PERCEPTION_INFER, PERCEPTION_LOAD, PERCEPTION_TEXT
from surveilnav.errors import TargetError
from surveilnav.messages import InferRequest, TextReply, WorkerLoad
from surveilnav.perception.backend import Backend
from surveilnav.perception.prompts import word_in_prompt
from surveilnav.sensing.packing import pack_embedding
from surveilnav.services.perception.config import PerceptionSettings
from surveilnav.services.perception.core.checks import check_texts
from surveilnav.services.perception.embedding import EmbeddingStage
from surveilnav.services.perception.inference import InferenceHandler
from surveilnav.services.perception.warm_up import check_backend

_WARM_UP_MS = 2000  # requests before the worker is ready are told to come again after this time
_QUERIES_PER_VIEW = 16  # capacity of the query queue, per view that may be in progress; it empties fast
_LOAD_PERIOD_S = 1.0


class PerceptionService:
    """Serves one backend on the bus, and publishes once a second how busy it is.

    Attributes:
        ready: whether it accepts requests; True after ``warm_up``.
    """

    def __init__(self, node: Node, backend: Backend, settings: PerceptionSettings) -> None:
        self._node, self._backend, self._settings = node, backend, settings
        self.ready = False
        self._load_published_s = 0.0
        self._published_times: dict[str, list[int]] = {}
        self._embedding = EmbeddingStage(backend)
        self._inference = InferenceHandler(node, backend, self._embedding, settings)
        worker, capacity = settings.worker, _QUERIES_PER_VIEW * settings.capacity
        self._load_publisher = node.publisher(PERCEPTION_LOAD, worker=worker)
        retry_after_ms = self._inference.pipeline.retry_after_ms
        node.serve(PERCEPTION_LOAD, lambda _: Answer(self.load()), worker=worker)
        node.serve(PERCEPTION_TEXT, self.embed_texts, retry_after_ms=retry_after_ms, worker=worker)
        node.serve(PERCEPTION_INFER, self.infer, capacity=capacity, retry_after_ms=retry_after_ms, worker=worker)

    def warm_up(self) -> None:
        """Has the backend process a probe picture, alone and in a batch, and embed a word; then accepts requests.

        Raises:
            PerceptionError: the backend fails, or its answer is malformed.
        """
        for n in (1, self._settings.max_batch or self._backend.best_batch):
            check_backend(self._backend, self._embedding, n)
        self.ready = True

    def infer(self, query: Request) -> Answer | Future[Any]:
        """Answers a request about a view, or cancels one."""
        self._expect_ready()
        if query.message.cancel:
            return self._inference.cancel(query.message)
        self._node.log_once("looks at views for a request", source=query.message.source)
        return self._inference.infer(query.message, query.payload, query.received_ns)

    def embed_texts(self, query: Request) -> Answer:
        """Answers a request for embeddings of texts."""
        self._expect_ready()
        request: InferRequest = query.message
        check_texts(request)
        try:
            embeddings = [pack_embedding(vector) for vector in self._embedding.embed_texts(request.texts)]
        except TargetError as error:
            raise Refused("bad_target", str(error)) from error
        return Answer(
            TextReply(
                stamp_ns=clock_ns(),
                worker=self._settings.worker,
                backend=self._backend.name,
                embeddings=embeddings,
                words=[self._backend.find_name(word_in_prompt(text)) for text in request.texts],
                models=self._backend.models,
                vocabulary=list(self._backend.vocabulary or ()),
            )
        )

    def _expect_ready(self) -> None:
        """Refuses requests during the warm-up, when the backend is busy with the probe."""
        if not self.ready:
            raise Refused("not_ready", "this worker warms up: ask again later or ask another worker", _WARM_UP_MS)

    def step(self) -> bool:
        """One turn of the loop: publishes the load when it is due."""
        now_s = time.monotonic()
        if now_s - self._load_published_s >= _LOAD_PERIOD_S:
            self._load_published_s = now_s
            load, known_times = self.load(), self._published_times
            self._published_times = load.times
            self._load_publisher.put(load.to_publish(known_times))
        return False

    def load(self) -> WorkerLoad:
        """How busy and how fast the worker is, and which backend runs."""
        pipeline = self._inference.pipeline
        return WorkerLoad(
            stamp_ns=clock_ns(),
            worker=self._settings.worker,
            backend=self._backend.name,
            why=self._backend.why,
            queued=pipeline.in_progress,
            capacity=self._settings.capacity,
            latency_ms=pipeline.latency_ms,
            ready=self.ready,
            models=self._backend.models,
            times=pipeline.duration_counts(),
            cached=self._inference.cache_hits,
            open_vocabulary=self._backend.vocabulary is None,
            calibrated=self._backend.calibrated,
            handover=self._node.handover.token,
        )
