"""Which perception worker gets a request, and when a second one gets it, too.

A worker that dies is noticed by its presence token; one that hangs, only by its silence. So a worker gets a time to answer that
fits its own speed. After that the request is sent to another worker as well, and the first answer counts (hedged requests:
Dean & Barroso 2013, "The tail at scale").
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable

from surveilnav.messages import WorkerLoad

_PATIENCE_FACTOR = 4.0  # times the expected time of an answer: after that a worker is late
_MIN_PATIENCE_S = 0.5
_MAX_PATIENCE_SHARE = 0.25  # of a request's time-out
_SILENCE_S = 30.0  # for which a worker that was late comes last


class WorkerSelector:
    """Keeps track of the requests under way and of workers that don't answer. Not thread-safe."""

    def __init__(self) -> None:
        self._under_way: Counter[str] = Counter()
        self._silent_since_s: dict[str, float] = {}

    def rank(self, loads: Iterable[WorkerLoad], now_s: float) -> list[WorkerLoad]:
        """Orders workers: first those that answer, then the least loaded, then the fastest.

        Workers that aren't ready are left out, and so are loads with impossible numbers.
        """
        usable = [load for load in loads if load.ready and load.queued >= 0 and load.latency_ms >= 0]
        return sorted(usable, key=lambda load: (self._is_silent(load.worker, now_s), *self._burden(load), load.worker))

    def patience_s(self, load: WorkerLoad, timeout_s: float) -> float:
        """How long to wait for a worker's answer before another worker is asked as well."""
        expected_s = (load.queued + self._under_way[load.worker] + 1) * load.latency_ms / 1000
        longest_s = _MAX_PATIENCE_SHARE * timeout_s
        return min(max(_PATIENCE_FACTOR * expected_s, _MIN_PATIENCE_S), longest_s) if expected_s else longest_s

    def record_request(self, worker: str) -> None:
        self._under_way[worker] += 1

    def record_late(self, worker: str, now_s: float) -> None:
        """Records that a worker hasn't answered within its time."""
        self._silent_since_s[worker] = now_s

    def record_end(self, worker: str, *, answered: bool) -> None:
        """Records that a request to a worker is over. ``answered``: whether the worker answered or refused it."""
        self._under_way[worker] -= 1
        if answered:
            self._silent_since_s.pop(worker, None)

    def _is_silent(self, worker: str, now_s: float) -> bool:
        return now_s - self._silent_since_s.get(worker, -math.inf) < _SILENCE_S

    def _burden(self, load: WorkerLoad) -> tuple[float, float]:
        # the worker's own count may be a second old and doesn't contain what was sent from here since
        return max(load.queued, self._under_way[load.worker]), load.latency_ms
