"""Sends requests to perception workers. If a worker hangs, another one is asked as well."""

from __future__ import annotations

import queue
import threading
import time
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from typing import Any, NamedTuple

import msgspec

from surveilnav.bus import Node, Received, Refused, keep_request_id
from surveilnav.contract import PERCEPTION_INFER, PERCEPTION_LOAD, Stream
from surveilnav.errors import PerceptionError, SurveilNavError
from surveilnav.messages import InferRequest, WorkerLoad
from surveilnav.services.fusion.core.views.worker_selector import WorkerSelector

#: Refusals that have to do with the worker's state, so that another worker may answer.
_RETRYABLE = {"busy", "not_ready", "too_late", "no_prompt"}

_GRACE_S = 1.0  # beyond the time-out, for the bus to report it
_DEADLINE_SHARE = 0.9  # of the remaining time, as the worker's deadline; the rest is for sending the answer
_CANCEL_TIMEOUT_S = 1.0


class _WorkerReply(NamedTuple):
    """A worker's answer to a request, or the error with which the request ended."""

    worker: str
    result: Received[Any] | Exception


class Workers:
    """A client of all perception workers on the bus. Safe from any thread."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._loads = node.table(PERCEPTION_LOAD)
        self._selector, self._lock = WorkerSelector(), threading.Lock()
        self._open_vocabulary, self._embedder = False, ""  # as of when a worker was last there
        node.alive("perception")  # the first call starts to follow presence

    @property
    def open_vocabulary(self) -> bool:
        """Whether any worker detects arbitrary words. While no worker is there, the last answer holds."""
        if loads := self._loads_now():
            self._open_vocabulary = any(load.open_vocabulary for load in loads)
        return self._open_vocabulary

    @property
    def needs_words(self) -> bool:
        """Whether no worker detects anything unless it is given words."""
        loads = self._loads_now()
        return bool(loads) and all(load.open_vocabulary for load in loads)

    @property
    def embedder(self) -> str:
        """The embedding model that most workers run. While no worker is ready, the last answer holds."""
        models = Counter(load.models.embedder for load in self._loads_now() if load.ready)
        if models:
            self._embedder = min(models, key=lambda model: (-models[model], model))
        return self._embedder

    def ask(
        self, stream: Stream, request: InferRequest, payload: bytes = b"", *, timeout_s: float, embedder: str = ""
    ) -> Received[Any]:
        """Sends a request to the best worker, and to the next ones as needed; returns the first answer.

        The next worker is asked as soon as the previous one is late, or refuses for a reason that may not hold for others. Its
        deadline is the time that is left. Once an answer has arrived, the other workers are told to drop the request.

        Args:
            embedder: if any worker runs this embedding model, only such workers are asked.

        Raises:
            PerceptionError: no worker is there, or none answers in time.
            Refused, BusError: the last error, if every worker has failed.
        """
        untried, until_s = self.ranked(), time.monotonic() + timeout_s
        untried = [load for load in untried if load.models.embedder == embedder] or untried
        replies: queue.Queue[_WorkerReply] = queue.Queue()
        waiting_for: list[str] = []
        while True:
            # ask one more worker
            asked, left_s = None, until_s - time.monotonic()
            if untried and left_s > 0:
                asked = untried.pop(0)
                waiting_for.append(asked.worker)
                self._send(replies, asked, stream, request, payload, left_s)
            # wait for whoever answers first; if there is another worker to ask, only until this one is late
            may_be_late = asked if untried else None
            patience_s = self._patience_s(may_be_late, timeout_s) if may_be_late else left_s + _GRACE_S
            try:
                worker, result = replies.get(timeout=max(patience_s, 0.0))
            except queue.Empty:
                if may_be_late is None:
                    raise PerceptionError(f"no worker answers within {timeout_s:g} s") from None
                self._record_late(may_be_late.worker)
                continue
            waiting_for.remove(worker)
            if isinstance(result, Received):
                self._cancel(stream, request, waiting_for)
                return result
            is_last = not waiting_for and (not untried or time.monotonic() >= until_s)
            if is_last or not _is_retryable(result):
                raise result

    def _send(
        self,
        replies: queue.Queue[_WorkerReply],
        load: WorkerLoad,
        stream: Stream,
        request: InferRequest,
        payload: bytes,
        timeout_s: float,
    ) -> None:
        """Sends a request to a worker on a thread of its own, which puts the outcome into ``replies``."""
        worker = load.worker
        deadline_ms = min(request.deadline_ms, int(_DEADLINE_SHARE * 1000 * timeout_s))
        request = msgspec.structs.replace(request, deadline_ms=deadline_ms)

        def ask() -> None:
            result: Received[Any] | Exception
            try:
                result = self._ask(load, stream, request, payload, timeout_s)
            except Exception as error:
                result = error
            with self._lock:
                self._selector.record_end(worker, answered=_shows_life(result))
                if not isinstance(result, Received | Refused):
                    self._selector.record_late(worker, time.monotonic())
            replies.put(_WorkerReply(worker, result))

        with self._lock:
            self._selector.record_request(worker)
        threading.Thread(target=keep_request_id(ask), name=f"ask-{worker}", daemon=True).start()

    def _ask(
        self, load: WorkerLoad, stream: Stream, request: InferRequest, payload: bytes, timeout_s: float
    ) -> Received[Any]:
        """Asks a worker. It is handed the picture if it sees the same folder, and sent it if it doesn't find it there."""
        folder, until_s = self._node.handover, time.monotonic() + timeout_s
        if payload and folder.token and load.handover == folder.token and (name := folder.put(payload)):
            try:
                handed = msgspec.structs.replace(request, handed=name)
                return self._node.ask(stream, handed, timeout_s=timeout_s, worker=load.worker)
            except Refused as error:
                if error.name != "not_handed":
                    raise
        left_s = max(0.1, until_s - time.monotonic())
        return self._node.ask(stream, request, payload=payload, timeout_s=left_s, worker=load.worker)

    def _cancel(self, stream: Stream, request: InferRequest, workers: Iterable[str]) -> None:
        """Tells workers that a request has been answered, so that they drop it if it still waits."""
        if stream is not PERCEPTION_INFER or not request.asker:
            return
        cancellation = InferRequest(
            stamp_ns=request.stamp_ns,
            source=request.source,
            view=request.view,
            seq=request.seq,
            asker=request.asker,
            cancel=True,
        )

        def send(worker: str) -> None:
            with suppress(SurveilNavError):  # then the worker perceives the view in vain
                self._node.ask(stream, cancellation, timeout_s=_CANCEL_TIMEOUT_S, worker=worker)

        for worker in workers:
            threading.Thread(target=keep_request_id(send), args=(worker,), name=f"cancel-{worker}", daemon=True).start()

    def _patience_s(self, load: WorkerLoad, timeout_s: float) -> float:
        with self._lock:
            return self._selector.patience_s(load, timeout_s)

    def _record_late(self, worker: str) -> None:
        with self._lock:
            self._selector.record_late(worker, time.monotonic())

    def ranked(self) -> list[WorkerLoad]:
        """The workers that may be asked, the best first. PerceptionError: no worker is there, or none is ready."""
        loads = self._loads_now()
        with self._lock:
            ranked = self._selector.rank(loads, time.monotonic())
        if not ranked:
            raise PerceptionError("no worker is there" if not loads else "no worker is ready yet")
        return ranked

    def _loads_now(self) -> list[WorkerLoad]:
        rows = self._loads.rows(max_age_s=PERCEPTION_LOAD.max_age_ms / 1000)
        # a load counts only if it names the worker of its key, and that worker is alive
        alive = self._node.alive("perception")
        return [r.message for r in rows if r.message.worker == r.ids["worker"] and r.ids["worker"] in alive]


def _shows_life(result: Received[Any] | Exception) -> bool:
    """Whether a result shows that a worker serves requests. A cancelled request doesn't."""
    return isinstance(result, Received) or (isinstance(result, Refused) and result.name != "cancelled")


def _is_retryable(error: Exception) -> bool:
    """Whether another worker may answer where one failed with this error."""
    return error.name in _RETRYABLE if isinstance(error, Refused) else isinstance(error, SurveilNavError)
