"""When a service that ended is started again, and when that is given up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile


@dataclass(frozen=True, slots=True)
class RestartPolicy:
    """After ``first_s``, each time in a row after twice as long, at most ``longest_s``. Given up after ``most`` restarts in a
    row; who lives for ``settled_s`` begins a new row, as with Docker's and systemd's counts."""

    first_s: float = 0.5
    longest_s: float = 30.0
    most: int = 8
    settled_s: float = 120.0

    def wait_s(self, lives_s: Sequence[float]) -> float | None:
        """How long to wait after the last of a service's ends; None: give up.

        Args:
            lives_s: how long it lived each time, in order, at least one [s].
        """
        row = sum(1 for _ in takewhile(lambda life_s: life_s < self.settled_s, reversed(lives_s))) or 1
        if row > self.most:
            return None
        return min(self.longest_s, self.first_s * 2.0 ** (row - 1))
