"""Handles requests about views: checks them, answers them from the cache or passes them through the stages."""

from __future__ import annotations

import threading
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any

from surveilnav.bus import Answer, Node, Refused, clock_ns
from surveilnav.errors import PerceptionError, WireError
from surveilnav.messages import InferReply, InferRequest
from surveilnav.perception.backend import Backend, Stage, ViewTask
from surveilnav.services.perception.config import PerceptionSettings
from surveilnav.services.perception.core.checks import check_view
from surveilnav.services.perception.core.refusal import Refusal
from surveilnav.services.perception.core.reply import CachedReply, build_reply
from surveilnav.services.perception.embedding import EmbeddingStage
from surveilnav.services.perception.pending_request import PendingRequest
from surveilnav.services.perception.reply_cache import ReplyCache
from surveilnav.services.perception.stage_pipeline import PipelineStage, StagePipeline
from surveilnav.services.perception.truth_channel import ask_for_truth

_EXPIRE_PERIOD_S = 0.05


class InferenceHandler:
    """Answers requests about views. ``pipeline``: where they are processed."""

    def __init__(self, node: Node, backend: Backend, embedding: EmbeddingStage, settings: PerceptionSettings) -> None:
        self._handover = node.handover
        self._node, self._backend, self._embedding, self._worker = node, backend, embedding, settings.worker
        self._cache, self._prompt_embedder = ReplyCache(backend, settings), ThreadPoolExecutor(1, "new prompts")
        self.pipeline = StagePipeline(self._stages(settings), settings.capacity, node.stopping)
        threading.Thread(target=self._expire, name="expire", daemon=True).start()

    def _stages(self, settings: PerceptionSettings) -> list[PipelineStage]:
        """Decoding, the backend's stages, and the reply."""
        *first, last = self._backend.stages
        max_batch = settings.max_batch or self._backend.best_batch
        return [
            PipelineStage("decode", lambda batch: batch[0].decode(), threads=settings.decoders),
            *(_backend_stage(stage, max_batch) for stage in first),
            PipelineStage(last.name, lambda batch: self._embedding.run(batch, _tasks(batch)), max_batch),
            PipelineStage("answer", lambda batch: self._reply(batch[0])),
        ]

    @property
    def cache_hits(self) -> int:
        """How many requests were answered from the cache."""
        return self._cache.hits

    def infer(self, request: InferRequest, payload: bytes, received_ns: int) -> Answer | Future[Any]:
        """The answer to a request, or its future.

        Raises:
            WireError: the request or its picture is malformed.
            Refused: it can't be processed; the name says why.
        """
        payload = self._picture(request, payload)
        try:
            check_view(request, payload, needs_prompts=self._backend.needs_prompts)
        except Refusal as error:
            raise Refused(error.name, str(error)) from error
        pending = PendingRequest(request, payload, embedding_only=not request.detects and self._backend.needs_prompts)
        if self._backend.needs_truth:  # so its replies depend on more than the picture
            pending.load_truth = partial(ask_for_truth, self._node, self._backend.name, *pending.view_key)
        else:
            pending.cache_key = self._cache.key_for(request, payload)
            cached = self._cache.get(pending.cache_key)
            if cached is not None:
                return self._reply_from_cache(request, cached)
        self.pipeline.submit(pending.job(received_ns))
        return pending.answer

    def _picture(self, request: InferRequest, payload: bytes) -> bytes:
        """The picture of a request: its payload, or what was handed over in the folder. Refused: it isn't there any more."""
        picture = self._handover.get(request.handed) if request.handed else payload
        if picture is None:
            raise Refused("not_handed", "the picture isn't in the folder: send it")
        return picture

    def _reply_from_cache(self, request: InferRequest, cached: CachedReply) -> Answer | Future[Any]:
        """The cached reply for this request. If its prompts are new, a future: their embedding waits for the backend."""

        def answer() -> Answer:
            try:
                embeddings = self._embedding.embed_known(request.prompts)
            except PerceptionError as error:
                raise Refused("perception_failed", str(error)) from error
            return Answer(cached.reply_to(request, embeddings, worker=self._worker, stamp_ns=clock_ns()))

        return answer() if self._embedding.are_cached(request.prompts) else self._prompt_embedder.submit(answer)

    def cancel(self, request: InferRequest) -> Answer:
        """Refuses the request that ``request`` cancels, if it still waits. Raises WireError if it names no asker."""
        if not request.asker:
            raise WireError("expected a cancel to name the asker whose request it is, got none")
        self.pipeline.cancel(lambda pending: pending.is_cancelled_by(request))
        return Answer(
            InferReply(
                stamp_ns=clock_ns(),
                worker=self._worker,
                backend=self._backend.name,
                source=request.source,
                view=request.view,
                seq=request.seq,
                detections=[],
                image_embedding=b"",
            )
        )

    def _reply(self, pending: PendingRequest) -> None:
        """The last stage: sets and caches the reply."""
        perception = pending.task.result if pending.task is not None else None
        assert perception is not None, f"the last stage of {self._backend.name} gave no answer"
        reply = build_reply(
            pending.request,
            perception,
            pending.prompt_embeddings,
            models=self._backend.models,
            worker=self._worker,
            latency_ms=pending.processing_ms,
            stamp_ns=clock_ns(),
        )
        if pending.cache_key:
            self._cache.put(pending.cache_key, reply, perception.image_embedding)
        pending.reply = Answer(reply)

    def _expire(self) -> None:
        """Refuses what has waited too long, until the process ends."""
        while not self._node.stopping.wait(_EXPIRE_PERIOD_S):
            self.pipeline.expire()


def _backend_stage(stage: Stage, max_batch: int) -> PipelineStage:
    return PipelineStage(stage.name, lambda batch: stage.run(_tasks(batch)), max_batch)


def _tasks(batch: list[PendingRequest]) -> list[ViewTask]:
    tasks = [pending.task for pending in batch if pending.task is not None]
    assert len(tasks) == len(batch), "all were decoded before"
    return tasks
