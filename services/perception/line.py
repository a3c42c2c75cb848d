"""The stages of a worker, each on threads of its own: a free stage takes what waits before it, as one batch."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from surveilnav.bus import clock_ns
from surveilnav.histogram import Histogram
from surveilnav.services.perception.asked import Asked
from surveilnav.services.perception.core.queue import Job, StageQueues, Turned

_POLL_S = 0.2


@dataclass(frozen=True, slots=True)
class Step:
    """One stage: what runs, on how many views at most, on how many threads."""

    name: str
    run: Callable[[list[Asked]], None]
    most: int = 1
    threads: int = 1


class Line:
    """Moves views through ``steps``, in order; the last one leaves the reply. ``latency_ms``: of a view, without waiting."""

    def __init__(self, steps: Sequence[Step], capacity: int, stopping: threading.Event) -> None:
        self._names = tuple(step.name for step in steps)
        self._stopping = stopping
        self._queues: StageQueues[Asked] = StageQueues(self._names, capacity)
        self._changed = threading.Condition()
        self._times = {name: Histogram() for name in ("queue", *self._names)}
        self.latency_ms = 0.0
        for step in steps:
            for i in range(step.threads):
                threading.Thread(target=self._work, args=(step,), name=f"{step.name}-{i}", daemon=True).start()

    @property
    def under_way(self) -> int:
        """Views let in and not answered yet."""
        return self._queues.under_way

    def counts(self) -> dict[str, list[int]]:
        """By stage, and for "queue", how many views took how long, in the buckets of ``surveilnav.histogram``."""
        with self._changed:
            return {name: list(histogram.counts) for name, histogram in self._times.items()}

    def admit(self, job: Job[Asked]) -> bool:
        """Counts a view in; False: it was refused."""
        with self._changed:
            turned = self._queues.admit(job, clock_ns())
        self._turn_away(turned)
        return all(t.job is not job for t in turned)

    def enter(self, job: Job[Asked], stage: str = "") -> None:
        """Has an admitted view wait before a stage; empty: the first."""
        with self._changed:
            self._queues.put(job, stage or self._names[0], clock_ns())
            self._changed.notify_all()

    def refuse(self, job: Job[Asked], error: Exception) -> None:
        """Ends an admitted view that waits before no stage."""
        with self._changed:
            self._queues.finish(job, clock_ns())
        job.item.refuse(error)

    def cancel(self, is_meant: Callable[[Asked], bool]) -> None:
        """Refuses what waits and is of no use any more."""
        with self._changed:
            turned = self._queues.cancel(is_meant)
        self._turn_away(turned)

    def retry_after_ms(self) -> int:
        """When who is refused now may come again [ms]."""
        with self._changed:
            return self._queues.retry_after_ms()

    def expire(self) -> None:
        """Refuses what waits in vain, however long a stage may take."""
        with self._changed:
            late = self._queues.expire(clock_ns())
        self._turn_away(late)

    def _work(self, step: Step) -> None:
        while not self._stopping.is_set():
            with self._changed:
                batch, late = self._queues.take(step.name, step.most, clock_ns())
                if not (batch or late):
                    self._changed.wait(_POLL_S)
                    continue
            self._turn_away(late)
            if batch:
                start_s = time.perf_counter()
                done = self._tried(step, batch)
                self._advance(step.name, done, (time.perf_counter() - start_s) * 1e3)

    def _tried(self, step: Step, batch: list[Job[Asked]]) -> list[Job[Asked]]:
        """The jobs that went well. A batch that fails is tried one by one: one bad picture fails alone."""
        try:
            step.run([job.item for job in batch])
            return batch
        except Exception as error:
            if len(batch) == 1:
                self.refuse(batch[0], error)
                return []
        return [done for job in batch for done in self._tried(step, [job])]

    def _advance(self, name: str, done: list[Job[Asked]], took_ms: float) -> None:
        following = self._names[self._names.index(name) + 1 :]
        with self._changed:
            for job in done:
                self._times[name].add(took_ms)
                job.item.busy_ms += took_ms
                if following:
                    to = following[-2] if job.item.only_embeds and len(following) > 2 else following[0]
                    self._queues.put(job, to, clock_ns())
                else:
                    self._queues.finish(job, clock_ns())
                    self._times["queue"].add(job.waited_ns / 1e6)
                    self.latency_ms += (0.2 if self.latency_ms else 1.0) * (job.item.busy_ms - self.latency_ms)
            self._changed.notify_all()
        for job in () if following else done:  # when they are counted out: who is answered may ask again at once
            job.item.answer.set_result(job.item.reply)

    def _turn_away(self, turned: list[Turned[Asked]]) -> None:
        for t in turned:
            t.job.item.refuse(t.why)
