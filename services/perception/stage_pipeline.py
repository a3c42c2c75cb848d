"""Runs the stages of a worker, each on threads of its own: a free stage takes what waits before it as one batch."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from surveilnav.bus import clock_ns
from surveilnav.histogram import Histogram
from surveilnav.services.perception.core.queue import Job, RefusedJob, StageQueues
from surveilnav.services.perception.pending_request import PendingRequest

_POLL_S = 0.2


@dataclass(frozen=True, slots=True)
class PipelineStage:
    """One stage: its name in reports, the function that processes a batch, its largest batch, its number of threads."""

    name: str
    run: Callable[[list[PendingRequest]], None]
    max_batch: int = 1
    threads: int = 1


class StagePipeline:
    """Moves requests through ``stages`` in order; the last stage sets their reply.

    Attributes:
        latency_ms: moving average of the time that stages work on one view, without waiting for a stage.
    """

    def __init__(self, stages: Sequence[PipelineStage], capacity: int, stopping: threading.Event) -> None:
        """Starts the threads, which end when ``stopping`` is set. ``capacity``: requests waiting or processed at a time."""
        self._names = tuple(stage.name for stage in stages)
        self._stopping = stopping
        self._queues: StageQueues[PendingRequest] = StageQueues(self._names, capacity)
        #: Guards the queues; notified when a job was added to one.
        self._changed = threading.Condition()
        self._durations = {name: Histogram() for name in ("queue", *self._names)}
        self.latency_ms = 0.0
        for stage in stages:
            for i in range(stage.threads):
                threading.Thread(target=self._work, args=(stage,), name=f"{stage.name}-{i}", daemon=True).start()

    @property
    def in_progress(self) -> int:
        """Number of requests that were admitted and haven't been answered."""
        return self._queues.in_progress

    def duration_counts(self) -> dict[str, list[int]]:
        """By stage, and for "queue", how many views took how long, in the buckets of ``surveilnav.histogram``."""
        with self._changed:
            return {name: list(histogram.counts) for name, histogram in self._durations.items()}

    def submit(self, job: Job[PendingRequest]) -> None:
        """Puts a request into the queue of the first stage, or refuses it, or others in favour of it."""
        with self._changed:
            now_ns = clock_ns()
            refused = self._queues.admit(job, now_ns)
            if all(r.job is not job for r in refused):
                self._queues.enqueue(job, self._names[0], now_ns)
                self._changed.notify_all()
        _answer_refused(refused)

    def refuse(self, job: Job[PendingRequest], error: Exception) -> None:
        """Refuses an admitted request that is in no queue."""
        with self._changed:
            self._queues.finish(job, clock_ns())
        job.item.refuse(error)

    def cancel(self, matches: Callable[[PendingRequest], bool]) -> None:
        """Refuses the waiting requests that match, as "cancelled"."""
        with self._changed:
            refused = self._queues.cancel(matches)
        _answer_refused(refused)

    def retry_after_ms(self) -> int:
        """When a request that is refused now may be repeated [ms]."""
        with self._changed:
            return self._queues.retry_after_ms()

    def expire(self) -> None:
        """Refuses the waiting requests whose deadline has passed, even if a stage is stuck."""
        with self._changed:
            late = self._queues.expire(clock_ns())
        _answer_refused(late)

    def _work(self, stage: PipelineStage) -> None:
        while not self._stopping.is_set():
            with self._changed:
                batch, late = self._queues.next_batch(stage.name, stage.max_batch, clock_ns())
                if not (batch or late):
                    self._changed.wait(_POLL_S)
                    continue
            _answer_refused(late)
            if batch:
                start_s = time.perf_counter()
                succeeded = self._run(stage, batch)
                self._advance(stage.name, succeeded, (time.perf_counter() - start_s) * 1e3)

    def _run(self, stage: PipelineStage, batch: list[Job[PendingRequest]]) -> list[Job[PendingRequest]]:
        """Processes a batch and returns the jobs that succeeded.

        A batch that fails is repeated job by job, so that one bad picture fails alone.
        """
        try:
            stage.run([job.item for job in batch])
            return batch
        except Exception as error:
            if len(batch) == 1:
                self.refuse(batch[0], error)
                return []
        return [job for single in batch for job in self._run(stage, [single])]

    def _advance(self, name: str, jobs: list[Job[PendingRequest]], duration_ms: float) -> None:
        """Moves jobs on to the stage after ``name``, or answers them if it was the last."""
        following = self._names[self._names.index(name) + 1 :]
        with self._changed:
            for job in jobs:
                self._durations[name].add(duration_ms)
                job.item.processing_ms += duration_ms
                if following:
                    # The last two stages are the backend's last, which embeds, and the reply.
                    skips = job.item.embedding_only and len(following) > 2
                    self._queues.enqueue(job, following[-2] if skips else following[0], clock_ns())
                else:
                    self._queues.finish(job, clock_ns())
                    self._durations["queue"].add(job.waited_ns / 1e6)
                    weight = 0.2 if self.latency_ms else 1.0
                    self.latency_ms += weight * (job.item.processing_ms - self.latency_ms)
            self._changed.notify_all()
        if not following:  # answered only now, when the job is counted out: who is answered may ask again at once
            for job in jobs:
                job.item.answer.set_result(job.item.reply)


def _answer_refused(refused: list[RefusedJob[PendingRequest]]) -> None:
    for r in refused:
        r.job.item.refuse(r.why)
