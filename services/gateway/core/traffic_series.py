"""Offered bytes by kind of link over time: each second of the last hour, each minute of the last thirty days.

Nodes report when 32 kB are news, else every half minute, so a second holds what was reported in it: bytes may be counted up to
half a minute later than they were sent, and none is counted twice or left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

#: What is counted, in the order of columns.
LINKS: Final = ("camera", "robot", "server", "simulation")
#: Every node has reported within this time [s] of the first one.
FIRST_S: Final = 60.0
#: By step [s], how many are kept.
KEPT: Final = {1: 3600, 60: 30 * 24 * 60}


class TrafficPoint(NamedTuple):
    """Bytes by link, in the order of ``LINKS``, that were reported from ``at_s`` [s since the epoch] on for one step."""

    at_s: int
    n_bytes: tuple[int, ...]


@dataclass(slots=True)
class _Ring:
    """Sums of steps; a step's place is its number modulo their count. ``numbers``: which step each place holds; -1: none."""

    step_s: int
    numbers: NDArray[np.int64]
    sums: NDArray[np.int64]

    @classmethod
    def empty(cls, step_s: int, n: int) -> _Ring:
        return cls(step_s, np.full(n, -1, np.int64), np.zeros((n, len(LINKS)), np.int64))

    def add(self, at_s: float, n_bytes: NDArray[np.int64]) -> None:
        number = int(at_s) // self.step_s
        place = number % len(self.numbers)
        if self.numbers[place] > number:
            return  # the clock was set back by more than all that is kept
        if self.numbers[place] != number:
            self.numbers[place], self.sums[place] = number, 0
        self.sums[place] += n_bytes

    def since(self, since_s: float, now_s: float) -> Iterator[TrafficPoint]:
        last = int(now_s) // self.step_s
        first = max(int(since_s) // self.step_s, last - len(self.numbers) + 1)
        kept = np.flatnonzero((self.numbers >= first) & (self.numbers <= last))
        for place in kept[np.argsort(self.numbers[kept])]:
            at_s = int(self.numbers[place]) * self.step_s
            yield TrafficPoint(at_s, tuple(int(n) for n in self.sums[place]))


@dataclass(slots=True)
class TrafficSeries:
    """Fed with totals that grow; a process that was started again counts from 0. Not thread-safe."""

    _rings: dict[int, _Ring] = field(default_factory=lambda: {s: _Ring.empty(s, n) for s, n in KEPT.items()})
    _totals: dict[str, tuple[int, ...]] = field(default_factory=dict)
    _began_s: float | None = None

    def record(self, totals: dict[str, tuple[int, ...]], now_s: float) -> None:
        """Adds what was counted since the last call.

        Args:
            totals: by node, the bytes that it has offered by link since it started, in the order of ``LINKS``. A node that is
                new, or whose totals have become smaller, has started since; its totals are what it has offered. But within
                ``FIRST_S`` of the first call, nodes are new because they haven't reported before: what they sent is older.
        """
        self._began_s = now_s if self._began_s is None else self._began_s
        news = np.zeros(len(LINKS), np.int64)
        for node, total in totals.items():
            before = self._totals.get(node, total if now_s - self._began_s < FIRST_S else (0,) * len(LINKS))
            if any(now < then for now, then in zip(total, before, strict=True)):
                before = (0,) * len(LINKS)
            news += np.subtract(total, before)
        self._totals |= totals
        if news.any():
            for ring in self._rings.values():
                ring.add(now_s, news)

    def since(self, step_s: int, since_s: float, now_s: float) -> list[TrafficPoint]:
        """The steps from ``since_s`` on in which something was counted, oldest first. KeyError: no such step."""
        return list(self._rings[step_s].since(since_s, now_s))
