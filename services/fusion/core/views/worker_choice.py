"""Which perception worker is asked, and when another is asked beside it.

A worker that dies is noticed by its presence, one that hangs only by its silence. So who is asked gets a while that fits
its own speed; then another worker is asked, too, and the first answer counts (hedged requests: Dean & Barroso 2013, "The
tail at scale").
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable

from surveilnav.messages import WorkerLoad

_TIMES_LONGER = 4.0  # than its load lets expect: then a worker is late
_LEAST_PATIENCE_S = 0.5
_TIMEOUT_SHARE = 0.25  # no worker gets more of the time-out for itself
_SHUNNED_S = 30.0  # after that a silent worker is tried again


class WorkerChoice:
    """Remembers who was asked and who stays silent. Not for several threads at a time."""

    def __init__(self) -> None:
        self._under_way: Counter[str] = Counter()
        self._silent_since_s: dict[str, float] = {}

    def ranked(self, loads: Iterable[WorkerLoad], now_s: float) -> list[WorkerLoad]:
        """Workers that may be asked, the best first: those that answer, then the least loaded. Unready ones are left out,
        and loads that can't be."""
        able = [load for load in loads if load.ready and load.queued >= 0 and load.latency_ms >= 0]
        return sorted(able, key=lambda load: (self._is_silent(load.worker, now_s), *self._burden(load), load.worker))

    def patience_s(self, load: WorkerLoad, timeout_s: float) -> float:
        """How long a worker is waited for before another is asked, too."""
        expected_s = (load.queued + self._under_way[load.worker] + 1) * load.latency_ms / 1000
        longest_s = _TIMEOUT_SHARE * timeout_s
        return min(max(_TIMES_LONGER * expected_s, _LEAST_PATIENCE_S), longest_s) if expected_s else longest_s

    def asked(self, worker: str) -> None:
        """A worker was sent a request."""
        self._under_way[worker] += 1

    def overdue(self, worker: str, now_s: float) -> None:
        """A worker has kept its caller waiting for longer than it should."""
        self._silent_since_s[worker] = now_s

    def ended(self, worker: str, *, answered: bool) -> None:
        """A request to a worker is over; ``answered``: by an answer or a refusal."""
        self._under_way[worker] -= 1
        if answered:
            self._silent_since_s.pop(worker, None)

    def _is_silent(self, worker: str, now_s: float) -> bool:
        return now_s - self._silent_since_s.get(worker, -math.inf) < _SHUNNED_S

    def _burden(self, load: WorkerLoad) -> tuple[float, float]:
        # its own count is a second old at most; what was asked from here since isn't in it yet
        return max(load.queued, self._under_way[load.worker]), load.latency_ms
