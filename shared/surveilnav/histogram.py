"""Histograms of durations with fixed buckets, which can be sent, added up, and read as quantiles."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from typing import Final

#: Upper edges of the buckets [ms], four per doubling, so that a quantile is overestimated by at most a fifth. A last bucket
#: without an edge holds the durations of more than a minute.
EDGES_MS: Final[tuple[float, ...]] = tuple(0.25 * 2 ** (k / 4) for k in range(73))


class Histogram:
    """Counts of durations in the buckets of ``EDGES_MS``."""

    def __init__(self) -> None:
        self.counts = [0] * (len(EDGES_MS) + 1)

    def add(self, duration_ms: float) -> None:
        self.counts[bisect_left(EDGES_MS, duration_ms)] += 1


def quantile_ms(counts: Sequence[int], share: float) -> float | None:
    """The duration [ms] that the share ``share`` of the durations, such as 0.95, didn't exceed: an upper edge of a bucket.

    None if there are no durations, or the number of ``counts`` isn't that of the buckets.
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
