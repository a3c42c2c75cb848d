"""The way of a view through a worker: checked, remembered or let in, told the truth where a backend needs it, answered."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from surveilnav.bus import Answer, Node, Refused, clock_ns
from surveilnav.errors import PerceptionError, WireError
from surveilnav.messages import InferReply, InferRequest
from surveilnav.perception.backend import Backend, Stage, Work
from surveilnav.services.perception.answers import Answers
from surveilnav.services.perception.asked import Asked
from surveilnav.services.perception.config import PerceptionSettings
from surveilnav.services.perception.core.answer import Known, reply_to
from surveilnav.services.perception.core.checks import check_view
from surveilnav.services.perception.core.queue import Job
from surveilnav.services.perception.core.refusal import Refusal
from surveilnav.services.perception.embedding import Embedding
from surveilnav.services.perception.line import Line, Step
from surveilnav.services.perception.truth_channel import Told, TruthChannel

_SWEEP_S = 0.05  # between two looks for views whose time is over


class Views:
    """Takes views in and answers them; ``line`` is where they wait."""

    def __init__(self, node: Node, backend: Backend, embedding: Embedding, settings: PerceptionSettings) -> None:
        self._node, self._backend, self._embedding, self._worker = node, backend, embedding, settings.worker
        self._answers, self._later = Answers(backend, settings), ThreadPoolExecutor(1, "new prompts")
        last, most = backend.stages[-1], settings.max_batch or backend.best_batch
        self.line = Line(
            (
                Step("decode", lambda batch: batch[0].decode(), 1, settings.decoders),
                *(Step(stage.name, _runner(stage), most) for stage in backend.stages[:-1]),
                Step(last.name, lambda batch: embedding.last_stage(batch, _works(batch)), most),
                Step("answer", lambda batch: self._reply(batch[0])),
            ),
            settings.capacity,
            node.stopping,
        )
        self._truth = TruthChannel(node, backend.name, settings) if backend.needs_truth else None
        threading.Thread(target=self._sweep, name="sweep", daemon=True).start()

    @property
    def cached(self) -> int:
        """How many were answered by what was known."""
        return self._answers.hits

    def ask(self, request: InferRequest, payload: bytes, received_ns: int) -> Answer | Future[Any]:
        """The answer to a request, now or when its turn has come. WireError, Refused: it can't be."""
        try:
            check_view(request, payload, needs_prompts=self._backend.needs_prompts)
        except Refusal as error:
            raise Refused(error.name, str(error)) from error
        asked = Asked(request, payload, only_embeds=not request.detects and self._backend.needs_prompts)
        if self._truth is None:  # who is told the truth answers by that and the view's name, not by the picture
            asked.key = self._answers.key_of(request, payload)
            known = self._answers.get(asked.key)
            if known is not None:
                return self._again(request, known)
        self._let_in(asked.job(received_ns))
        return asked.answer

    def _again(self, request: InferRequest, known: Known) -> Answer | Future[Any]:
        """What was answered before, as an answer to this request; new prompts wait for the backend on another thread."""

        def answer() -> Answer:
            try:
                vectors = self._embedding.known(request.prompts)
            except PerceptionError as error:
                raise Refused("perception_failed", str(error)) from error
            return Answer(known.to(request, vectors, worker=self._worker, stamp_ns=clock_ns()))

        return answer() if self._embedding.knows(request.prompts) else self._later.submit(answer)

    def cancel(self, request: InferRequest) -> Answer:
        """Drops what waits of a request, if it does; the answer is empty. WireError: nobody is named who asked for it."""
        if not request.asker:
            raise WireError("expected a cancel to name the asker whose request it is, got none")
        self.line.cancel(lambda asked: asked.is_meant_by(request))
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

    def _let_in(self, job: Job[Asked]) -> None:
        if not self.line.admit(job):
            return
        if self._truth is None:
            self.line.enter(job)
        else:
            self._truth.ask(job.item.view_key, lambda told: self._tell(job, told))

    def _tell(self, job: Job[Asked], told: Told | Refused) -> None:
        if isinstance(told, Refused):
            self.line.refuse(job, told)
        else:
            job.item.told = told
            self.line.enter(job)

    def _reply(self, asked: Asked) -> None:
        seen = asked.work.seen if asked.work is not None else None
        assert seen is not None, f"the last stage of {self._backend.name} gave no answer"
        reply = reply_to(
            asked.request,
            seen,
            asked.vectors,
            models=self._backend.models,
            worker=self._worker,
            latency_ms=asked.busy_ms,
            stamp_ns=clock_ns(),
        )
        if asked.key:
            self._answers.put(asked.key, reply, seen.image_embedding)
        asked.reply = Answer(reply)

    def _sweep(self) -> None:
        while not self._node.stopping.wait(_SWEEP_S):
            self.line.expire()
            if self._truth is not None:
                self._truth.expire(time.monotonic())


def _runner(stage: Stage) -> Callable[[list[Asked]], None]:
    return lambda batch: stage.run(_works(batch))


def _works(batch: list[Asked]) -> list[Work]:
    works = [asked.work for asked in batch if asked.work is not None]
    assert len(works) == len(batch), "decoded before"
    return works
