"""Asks perception workers so that one that hangs delays nobody whom another can serve."""

from __future__ import annotations

import queue
import threading
import time
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

import msgspec

from surveilnav.bus import Node, Received, Refused
from surveilnav.contract import PERCEPTION_INFER, PERCEPTION_LOAD, Stream
from surveilnav.errors import PerceptionError, SurveilNavError
from surveilnav.messages import InferRequest, WorkerLoad
from surveilnav.services.fusion.core.views.worker_choice import WorkerChoice

#: Refusals of one worker that another needn't share.
_ITS_OWN = {"busy", "not_ready", "too_late", "no_prompt"}

_GRACE_S = 1.0  # for the bus to say that the time is over
_DEADLINE_SHARE = 0.9  # of the time that is left; the rest is for the answer's way
_CANCEL_S = 1.0  # for a worker to hear a cancel

#: A worker, and what came from it.
_Told = tuple[str, Received[Any] | Exception]


class Workers:
    """The perception workers that are there, seen from one that asks."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._loads = node.table(PERCEPTION_LOAD)
        self._choice, self._lock, self._open = WorkerChoice(), threading.Lock(), False
        self._embedder = ""
        node.alive("perception")  # the first call starts watching

    @property
    def open_vocabulary(self) -> bool:
        """Whether any of them looks for whatever words it is given; while none is there, what was so before."""
        if loads := self._loads_now():
            self._open = any(load.open_vocabulary for load in loads)
        return self._open

    @property
    def needs_words(self) -> bool:
        """Whether none of them finds anything without being given words."""
        loads = self._loads_now()
        return bool(loads) and all(load.open_vocabulary for load in loads)

    @property
    def embedder(self) -> str:
        """The embedding model that most workers run; while none is there, what it was before."""
        models = Counter(load.models.embedder for load in self._loads_now() if load.ready)
        if models:
            self._embedder = min(models, key=lambda model: (-models[model], model))
        return self._embedder

    def ask(
        self, stream: Stream, request: InferRequest, payload: bytes = b"", *, timeout_s: float, embedder: str = ""
    ) -> Received[Any]:
        """The first answer of the workers asked: the best one, and, as soon as that is late or refuses for its own sake,
        the next. Who is asked later is told how little time is left, and who is too late that it needn't look any more.

        ``embedder``: workers that run this model are asked alone, if there are any.

        Raises:
            PerceptionError: no worker is there.
            Refused, BusError: the last that went wrong, when nobody is left to answer.
        """
        untried, until_s = self.ranked(), time.monotonic() + timeout_s
        untried = [load for load in untried if load.models.embedder == embedder] or untried
        told: queue.Queue[_Told] = queue.Queue()
        waited_for: list[str] = []
        while True:
            late, left_s = "", until_s - time.monotonic()
            patience_s = left_s + _GRACE_S
            if untried and left_s > 0:
                load = untried.pop(0)
                waited_for.append(load.worker)
                self._send(told, load.worker, stream, request, payload, left_s)
                if untried:
                    late, patience_s = load.worker, self._patience_s(load, timeout_s)
            try:
                worker, answer = told.get(timeout=max(patience_s, 0.0))
            except queue.Empty:
                if not late:
                    raise PerceptionError(f"no worker answers within {timeout_s:g} s") from None
                self._overdue(late)
                continue
            waited_for.remove(worker)
            if isinstance(answer, Received):
                self._cancel(stream, request, waited_for)
                return answer
            nobody_left = not waited_for and (not untried or time.monotonic() >= until_s)
            if nobody_left or not _may_go_on(answer):
                raise answer

    def _send(
        self,
        told: queue.Queue[_Told],
        worker: str,
        stream: Stream,
        request: InferRequest,
        payload: bytes,
        timeout_s: float,
    ) -> None:
        deadline_ms = min(request.deadline_ms, int(_DEADLINE_SHARE * 1000 * timeout_s))
        request = msgspec.structs.replace(request, deadline_ms=deadline_ms)

        def ask() -> None:
            answer: Received[Any] | Exception
            try:
                answer = self._node.ask(stream, request, payload=payload, timeout_s=timeout_s, worker=worker)
            except Exception as error:
                answer = error
            with self._lock:
                self._choice.ended(worker, answered=_has_answered(answer))
                if not isinstance(answer, Received | Refused):
                    self._choice.overdue(worker, time.monotonic())
            told.put((worker, answer))

        with self._lock:
            self._choice.asked(worker)
        threading.Thread(target=ask, name=f"ask-{worker}", daemon=True).start()

    def _cancel(self, stream: Stream, request: InferRequest, workers: Iterable[str]) -> None:
        """Tells workers that what they were asked is of no use any more, so that they don't look at what still waits."""
        if stream is not PERCEPTION_INFER or not request.asker:
            return
        asked = InferRequest(
            stamp_ns=request.stamp_ns,
            source=request.source,
            view=request.view,
            seq=request.seq,
            asker=request.asker,
            cancel=True,
        )

        def tell(worker: str) -> None:
            with suppress(SurveilNavError):  # it looks in vain, then
                self._node.ask(stream, asked, timeout_s=_CANCEL_S, worker=worker)

        for worker in workers:
            threading.Thread(target=tell, args=(worker,), name=f"cancel-{worker}", daemon=True).start()

    def _patience_s(self, load: WorkerLoad, timeout_s: float) -> float:
        with self._lock:
            return self._choice.patience_s(load, timeout_s)

    def _overdue(self, worker: str) -> None:
        with self._lock:
            self._choice.overdue(worker, time.monotonic())

    def ranked(self) -> list[WorkerLoad]:
        """The workers that may be asked, the best first. PerceptionError: none is there, or ready."""
        loads = self._loads_now()
        with self._lock:
            ranked = self._choice.ranked(loads, time.monotonic())
        if not ranked:
            raise PerceptionError("no worker is there" if not loads else "no worker is ready yet")
        return ranked

    def _loads_now(self) -> list[WorkerLoad]:
        rows = self._loads.rows(max_age_s=PERCEPTION_LOAD.max_age_ms / 1000)
        # what a load says of itself is believed only of a worker that lives
        alive = self._node.alive("perception")
        return [r.message for r in rows if r.message.worker == r.ids["worker"] and r.ids["worker"] in alive]


def _has_answered(answer: Received[Any] | Exception) -> bool:
    """Whether a worker works: that it took in a cancel doesn't say so."""
    return isinstance(answer, Received) or (isinstance(answer, Refused) and answer.name != "cancelled")


def _may_go_on(error: Exception) -> bool:
    """Whether another worker may do better."""
    return error.name in _ITS_OWN if isinstance(error, Refused) else isinstance(error, SurveilNavError)
