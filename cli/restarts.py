"""When a service that ended is started again, and when that is given up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RestartPolicy:
    """After ``first_s``, each time after twice as long, at most ``longest_s``. Given up after more than ``most`` ends within
    ``within_s``; ends longer ago are forgiven."""

    first_s: float = 0.5
    longest_s: float = 8.0
    most: int = 5
    within_s: float = 60.0

    def wait_s(self, ends_s: Sequence[float]) -> float | None:
        """How long to wait after the last of a service's ends; None: give up.

        Args:
            ends_s: the times of all its ends, in order, at least one [s].
        """
        recent = sum(ends_s[-1] - end_s < self.within_s for end_s in ends_s)
        if recent > self.most:
            return None
        return min(self.longest_s, self.first_s * 2.0 ** (recent - 1))
