"""What waits before each stage of a worker: bounded, by priority, with deadlines.

The semantics are those of NVIDIA Triton's dynamic batcher, without its delay: a stage that falls free takes what waits, up
to its largest batch, and never waits for more.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from surveilnav.services.perception.core.refusal import Refusal

T = TypeVar("T")

_NEW_SHARE = 0.1  # of the newest view in the mean time between two answers
_FIRST_GUESS_MS, _LEAST_RETRY_MS, _MOST_RETRY_MS = 100.0, 10, 10_000


@dataclass(slots=True, eq=False)
class Job(Generic[T]):
    """One request on its way.

    Attributes:
        item: what the stages work on.
        urgent: it goes before all that aren't (a robot waits for its view, nobody for a camera's).
        deadline_ns: an answer after this is of no use to who asked.
        replaces: a newer job of this name takes the place of a waiting older one; None: of none.
        since_ns: when it began to wait where it is.
        waited_ns: how long it has waited before all stages so far.
        order: the how manieth it is.
    """

    item: T
    urgent: bool
    deadline_ns: int
    replaces: Hashable | None = None
    since_ns: int = 0
    waited_ns: int = 0
    order: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Turned(Generic[T]):
    """A job that was turned away, and why."""

    job: Job[T]
    why: Refusal


class StageQueues(Generic[T]):
    """The jobs that wait before ``stages``, up to ``capacity`` on their way at once. Not for several threads at a time."""

    def __init__(self, stages: Sequence[str], capacity: int) -> None:
        self._waiting: dict[str, list[Job[T]]] = {stage: [] for stage in stages}
        self._capacity = capacity
        self._under_way = 0
        self._order = 0
        self._interval_ms = _FIRST_GUESS_MS
        self._idle_until_ns = self._answered_ns = 0

    @property
    def under_way(self) -> int:
        """Jobs admitted and not finished yet."""
        return self._under_way

    def admit(self, job: Job[T], now_ns: int) -> list[Turned[T]]:
        """Counts a job in, or turns it away; returns who is turned away for it.

        A full worker turns away the newcomer. If that is urgent, the newest job that isn't goes instead.
        """
        if job.deadline_ns <= now_ns:
            return [Turned(job, Refusal("too_late", "the deadline had passed before the request arrived"))]
        turned = self._superseded(job)
        if self._under_way >= self._capacity:
            displaced = self._newest_that_can_wait() if job.urgent else None
            why = self._busy()
            if displaced is None:
                return [*turned, Turned(job, why)]
            turned.append(Turned(displaced, why))
            self._under_way -= 1
        if not self._under_way:
            self._idle_until_ns = now_ns
        self._order += 1
        self._under_way += 1
        job.order, job.since_ns = self._order, now_ns
        return turned

    def put(self, job: Job[T], stage: str, now_ns: int) -> None:
        """Has an admitted job wait before a stage."""
        job.since_ns = now_ns
        insort(self._waiting[stage], job, key=_rank)

    def take(self, stage: str, most: int, now_ns: int) -> tuple[list[Job[T]], list[Turned[T]]]:
        """The jobs that a free stage works on next, up to ``most``, and those that are too late."""
        waiting = self._waiting[stage]
        late = [job for job in waiting if job.deadline_ns <= now_ns]
        if late:
            waiting[:] = [job for job in waiting if job.deadline_ns > now_ns]
        batch, waiting[:most] = waiting[:most], []
        for job in batch:
            job.waited_ns += now_ns - job.since_ns
        return batch, [self._out(job, _too_late(job, now_ns)) for job in late]

    def expire(self, now_ns: int) -> list[Turned[T]]:
        """All that wait in vain: for when a stage doesn't fall free."""
        return [turned for stage in self._waiting for turned in self.take(stage, 0, now_ns)[1]]

    def cancel(self, is_meant: Callable[[T], bool]) -> list[Turned[T]]:
        """Turns away what waits and is of no use to who asked; what a stage works on goes on."""
        why = Refusal("cancelled", "who asked has no use for it any more")
        return self._removed(lambda job: is_meant(job.item), why)

    def finish(self, job: Job[T], now_ns: int) -> None:
        """Counts an admitted job out that left its stage, answered or refused."""
        taken_ms = (now_ns - max(self._answered_ns, self._idle_until_ns)) / 1e6
        self._interval_ms += _NEW_SHARE * (taken_ms - self._interval_ms)
        self._answered_ns = now_ns
        self._under_way -= 1

    def retry_after_ms(self) -> int:
        """When half of what is under way will have gone, at the pace of the last answers."""
        return round(min(max(self._interval_ms * self._under_way / 2, _LEAST_RETRY_MS), _MOST_RETRY_MS))

    def _superseded(self, newer: Job[T]) -> list[Turned[T]]:
        if newer.replaces is None:
            return []
        why = Refusal("superseded", "a newer request took the place of this one")
        return self._removed(lambda job: job.replaces == newer.replaces, why)

    def _removed(self, is_meant: Callable[[Job[T]], bool], why: Refusal) -> list[Turned[T]]:
        gone = [job for waiting in self._waiting.values() for job in waiting if is_meant(job)]
        for waiting in self._waiting.values():
            waiting[:] = [job for job in waiting if not is_meant(job)]
        return [self._out(job, why) for job in gone]

    def _newest_that_can_wait(self) -> Job[T] | None:
        """Taken out of the earliest stage that has one: it has cost least so far."""
        for waiting in self._waiting.values():
            if waiting and not waiting[-1].urgent:
                return waiting.pop()
        return None

    def _out(self, job: Job[T], why: Refusal) -> Turned[T]:
        self._under_way -= 1
        return Turned(job, why)

    def _busy(self) -> Refusal:
        after_ms = self.retry_after_ms()
        message = f"{self._under_way} views are under way already: ask again in {after_ms} ms or ask another worker"
        return Refusal("busy", message, after_ms)


def _rank(job: Job[T]) -> tuple[bool, int]:
    return not job.urgent, job.order


def _too_late(job: Job[T], now_ns: int) -> Refusal:
    late_ms = (now_ns - job.deadline_ns) / 1e6
    return Refusal("too_late", f"the deadline passed {late_ms:.0f} ms ago, in the queue")
