"""The requests that wait before each stage of a worker: bounded, by priority, with deadlines.

The semantics are those of NVIDIA Triton's dynamic batcher without its delay: a stage that becomes free takes what waits, up
to its largest batch, and never waits for more.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from surveilnav.services.perception.core.refusal import Refusal

T = TypeVar("T")

_SMOOTHING = 0.1  # weight of the newest interval in the mean time between two replies
_INITIAL_INTERVAL_MS, _MIN_RETRY_MS, _MAX_RETRY_MS = 100.0, 10, 10_000


@dataclass(slots=True, eq=False)
class Job(Generic[T]):
    """One request in the worker.

    Attributes:
        item: what the stages work on.
        urgent: served before all jobs that aren't. A robot waits for the result of its view; nobody waits for a camera's.
        deadline_ns: time after which the reply is of no use.
        replaces: identifies the jobs that this one supersedes: those that wait with the same value. None supersedes none.
        since_ns: when it joined the queue that it waits in.
        waited_ns: time that it has waited before all stages so far.
        order: arrival number; of equal priority, the earlier job is served first.
    """

    item: T
    urgent: bool
    deadline_ns: int
    replaces: Hashable | None = None
    since_ns: int = 0
    waited_ns: int = 0
    order: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class RefusedJob(Generic[T]):
    """A job that won't be processed, and why."""

    job: Job[T]
    why: Refusal


class StageQueues(Generic[T]):
    """A queue before each of the ``stages``; at most ``capacity`` jobs wait or are processed at a time. Not thread-safe."""

    def __init__(self, stages: Sequence[str], capacity: int) -> None:
        self._queues: dict[str, list[Job[T]]] = {stage: [] for stage in stages}
        self._capacity = capacity
        self._in_progress = 0
        self._order = 0
        self._interval_ms = _INITIAL_INTERVAL_MS
        self._idle_until_ns = self._finished_ns = 0

    @property
    def in_progress(self) -> int:
        """Number of jobs that were admitted and haven't finished."""
        return self._in_progress

    def admit(self, job: Job[T], now_ns: int) -> list[RefusedJob[T]]:
        """Admits or refuses a job. Returns all jobs refused because of it, possibly the job itself.

        A full worker refuses the new job. If that is urgent, it refuses the newest job that isn't instead.
        """
        if job.deadline_ns <= now_ns:
            return [RefusedJob(job, Refusal("too_late", "the deadline had passed before the request arrived"))]
        refused = self._supersede(job)
        if self._in_progress >= self._capacity:
            displaced = self._pop_newest_not_urgent() if job.urgent else None
            why = self._busy()
            if displaced is None:
                return [*refused, RefusedJob(job, why)]
            refused.append(RefusedJob(displaced, why))
            self._in_progress -= 1
        if not self._in_progress:
            self._idle_until_ns = now_ns
        self._order += 1
        self._in_progress += 1
        job.order, job.since_ns = self._order, now_ns
        return refused

    def enqueue(self, job: Job[T], stage: str, now_ns: int) -> None:
        """Puts an admitted job into the queue before a stage."""
        job.since_ns = now_ns
        insort(self._queues[stage], job, key=_rank)

    def next_batch(self, stage: str, max_batch: int, now_ns: int) -> tuple[list[Job[T]], list[RefusedJob[T]]]:
        """Takes the jobs that a free stage processes next, and those whose deadline has passed, out of its queue."""
        queue = self._queues[stage]
        late = [job for job in queue if job.deadline_ns <= now_ns]
        if late:
            queue[:] = [job for job in queue if job.deadline_ns > now_ns]
        batch, queue[:max_batch] = queue[:max_batch], []
        for job in batch:
            job.waited_ns += now_ns - job.since_ns
        return batch, [self._refuse(job, _too_late(job, now_ns)) for job in late]

    def expire(self, now_ns: int) -> list[RefusedJob[T]]:
        """Takes out all jobs whose deadline has passed, even where a stage doesn't become free."""
        return [refused for stage in self._queues for refused in self.next_batch(stage, 0, now_ns)[1]]

    def cancel(self, matches: Callable[[T], bool]) -> list[RefusedJob[T]]:
        """Takes out the waiting jobs whose item ``matches``. A job that a stage is processing goes on."""
        why = Refusal("cancelled", "who asked has no use for it any more")
        return self._remove(lambda job: matches(job.item), why)

    def finish(self, job: Job[T], now_ns: int) -> None:
        """Counts out a job that is in no queue, whether it was answered or refused."""
        interval_ms = (now_ns - max(self._finished_ns, self._idle_until_ns)) / 1e6
        self._interval_ms += _SMOOTHING * (interval_ms - self._interval_ms)
        self._finished_ns = now_ns
        self._in_progress -= 1

    def retry_after_ms(self) -> int:
        """When half of the jobs in progress will have finished, at the pace of the last replies."""
        return round(min(max(self._interval_ms * self._in_progress / 2, _MIN_RETRY_MS), _MAX_RETRY_MS))

    def _supersede(self, newer: Job[T]) -> list[RefusedJob[T]]:
        if newer.replaces is None:
            return []
        why = Refusal("superseded", "a newer request took the place of this one")
        return self._remove(lambda job: job.replaces == newer.replaces, why)

    def _remove(self, matches: Callable[[Job[T]], bool], why: Refusal) -> list[RefusedJob[T]]:
        removed = [job for queue in self._queues.values() for job in queue if matches(job)]
        for queue in self._queues.values():
            queue[:] = [job for job in queue if not matches(job)]
        return [self._refuse(job, why) for job in removed]

    def _pop_newest_not_urgent(self) -> Job[T] | None:
        """Out of the earliest stage that has one, where the least work is lost."""
        for queue in self._queues.values():
            if queue and not queue[-1].urgent:
                return queue.pop()
        return None

    def _refuse(self, job: Job[T], why: Refusal) -> RefusedJob[T]:
        self._in_progress -= 1
        return RefusedJob(job, why)

    def _busy(self) -> Refusal:
        after_ms = self.retry_after_ms()
        message = f"{self._in_progress} views are under way already: ask again in {after_ms} ms or ask another worker"
        return Refusal("busy", message, after_ms)


def _rank(job: Job[T]) -> tuple[bool, int]:
    return not job.urgent, job.order


def _too_late(job: Job[T], now_ns: int) -> Refusal:
    late_ms = (now_ns - job.deadline_ns) / 1e6
    return Refusal("too_late", f"the deadline passed {late_ms:.0f} ms ago, in the queue")
