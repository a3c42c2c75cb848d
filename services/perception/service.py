"""The perception worker: pictures in, detections and embeddings out; texts in, embeddings out."""

from __future__ import annotations

import time
from concurrent.futures import Future
from typing import Any

from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.contract import PERCEPTION_INFER, PERCEPTION_LOAD, PERCEPTION_TEXT
from surveilnav.errors import PerceptionError, TargetError
from surveilnav.messages import InferRequest, TextReply, WorkerLoad
from surveilnav.perception.backend import Backend
from surveilnav.perception.prompts import named
from surveilnav.sensing.packing import pack_embedding
from surveilnav.services.perception.config import PerceptionSettings
from surveilnav.services.perception.core import probe
from surveilnav.services.perception.core.checks import check_texts
from surveilnav.services.perception.embedding import Embedding
from surveilnav.services.perception.views import Views

_WARM_UP_MS = 2000  # who asks before a worker is ready is told to come again after this
_QUERIES_PER_VIEW = 16  # that may wait to be let in or refused, for each view that may be under way


class PerceptionService:
    """Answers queries with a backend, stage by stage; says at 1 Hz how busy it is.

    ``ready``: it looks at views; ``warm_up`` makes it so.
    """

    def __init__(self, node: Node, backend: Backend, settings: PerceptionSettings) -> None:
        self._backend, self._settings = backend, settings
        self.ready = False
        self._last_load_s = 0.0
        self._embedding = Embedding(backend)
        self._views = Views(node, backend, self._embedding, settings)
        worker, capacity = settings.worker, _QUERIES_PER_VIEW * settings.capacity
        self._load = node.publisher(PERCEPTION_LOAD, worker=worker)
        hint = self._views.line.retry_after_ms
        node.serve(PERCEPTION_LOAD, lambda _: Answer(self.load()), worker=worker)
        node.serve(PERCEPTION_TEXT, self.embed_texts, retry_after_ms=hint, worker=worker)
        node.serve(PERCEPTION_INFER, self.infer, capacity=capacity, retry_after_ms=hint, worker=worker)

    def warm_up(self) -> None:
        """Has the backend look at a probe picture, alone and in a batch, and embed a word.

        Raises:
            PerceptionError: it can't, or what it says makes no sense.
        """
        for n in (1, self._settings.max_batch or self._backend.best_batch):
            works = [probe.probe() for _ in range(n)]
            try:
                for stage in self._backend.stages:
                    stage.run(works)
                problems = [probe.problem(work.seen, self._backend.embedding_dim) for work in works]
                problems.append(self._embedding.problem(probe.PROMPTS))
            except Exception as error:  # whatever a model's library raises
                problems = [f"{type(error).__name__}: {error}"]
            if wrong := next(filter(None, problems), ""):
                raise PerceptionError(f"{self._backend.name} doesn't answer a probe picture rightly: {wrong}")
        self.ready = True

    def infer(self, query: Request) -> Answer | Future[Any]:
        """Detections and embeddings of one view, when its turn has come."""
        self._expect_ready()
        if query.message.cancel:
            return self._views.cancel(query.message)
        return self._views.ask(query.message, query.payload, query.received_ns)

    def embed_texts(self, query: Request) -> Answer:
        """Embeddings of texts."""
        self._expect_ready()
        request: InferRequest = query.message
        check_texts(request)
        try:
            embeddings = [pack_embedding(vector) for vector in self._embedding.texts(request.texts)]
        except TargetError as error:
            raise Refused("bad_target", str(error)) from error
        return Answer(
            TextReply(
                stamp_ns=clock_ns(),
                worker=self._settings.worker,
                backend=self._backend.name,
                embeddings=embeddings,
                words=[self._backend.understood(named(text)) for text in request.texts],
                models=self._backend.models,
                vocabulary=list(self._backend.vocabulary or ()),
            )
        )

    def _expect_ready(self) -> None:
        """Refused: the backend is busy with its probe, and serves one thread at a time."""
        if not self.ready:
            raise Refused("not_ready", "this worker warms up: ask again later or ask another worker", _WARM_UP_MS)

    def step(self) -> bool:
        """Says once a second how busy it is."""
        now = time.monotonic()
        if now - self._last_load_s >= 1.0:
            self._last_load_s = now
            self._load.put(self.load())
        return False

    def load(self) -> WorkerLoad:
        """Queue and speed, and which backend runs."""
        line = self._views.line
        return WorkerLoad(
            stamp_ns=clock_ns(),
            worker=self._settings.worker,
            backend=self._backend.name,
            why=self._backend.why,
            queued=line.under_way,
            capacity=self._settings.capacity,
            latency_ms=line.latency_ms,
            ready=self.ready,
            models=self._backend.models,
            times=line.counts(),
            cached=self._views.cached,
            open_vocabulary=self._backend.vocabulary is None,
            calibrated=self._backend.calibrated,
        )
