"""How long things take, as counts in buckets of fixed edges: such counts can be sent, added up and read as quantiles."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from typing import Final

#: Upper edges of the buckets [ms], four for each doubling: a quantile read from them is a fifth too long at most. The
#: last bucket has none: it holds all that takes longer than a minute.
EDGES_MS: Final[tuple[float, ...]] = tuple(0.25 * 2 ** (k / 4) for k in range(73))


class Histogram:
    """Counts of durations, by the buckets of ``EDGES_MS``."""

    def __init__(self) -> None:
        self.counts = [0] * (len(EDGES_MS) + 1)

    def add(self, duration_ms: float) -> None:
        """Counts one duration."""
        self.counts[bisect_left(EDGES_MS, duration_ms)] += 1


def quantile_ms(counts: Sequence[int], share: float) -> float | None:
    """The duration [ms] that ``share`` of those counted didn't exceed, e.g. 0.95; None where none was counted.

    It is the upper edge of its bucket. Counts of another length are no counts of ``EDGES_MS``: None, too.
    """
    total = sum(counts)
    if len(counts) != len(EDGES_MS) + 1 or total <= 0:
        return None
    seen = 0
    for edge_ms, count in zip(EDGES_MS, counts, strict=False):
        seen += count
        if seen >= share * total:
            return edge_ms
    return EDGES_MS[-1]
