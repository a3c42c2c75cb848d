"""From records to numbers: SR, SPL, SoftSPL in percent, with bootstrap intervals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.runner.records import EpisodeRecord
from surveilnav.building.goals import SUCCESS_M

RESAMPLES = 10_000
SUCCESS_RULE = f"`stop` within {SUCCESS_M:g} m (geodesic) of a viewpoint of any goal (Habitat's rule)"


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean in percent, or a ratio of two, and its 95 % interval."""

    mean: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.mean:.1f} [{self.low:.1f}, {self.high:.1f}]"


@dataclass(frozen=True, slots=True)
class Summary:
    """A run's numbers; ``reasons``: failures by name."""

    episodes: int
    sr: Interval
    spl: Interval
    soft_spl: Interval
    steps: float
    path_m: float
    reasons: dict[str, int]
    bytes: dict[str, float]


def summarise(records: Sequence[EpisodeRecord]) -> Summary:
    """The numbers of at least one record. ValueError: none."""
    if not records:
        raise ValueError("there is no episode to sum up")
    tiers = sorted({tier for r in records for tier in r.bytes})
    return Summary(
        len(records),
        interval([100.0 * r.success for r in records]),
        interval([100.0 * r.spl for r in records]),
        interval([100.0 * r.soft_spl for r in records]),
        float(np.mean([r.steps for r in records])),
        float(np.mean([r.path_m for r in records])),
        dict(sorted(Counter(r.reason for r in records if r.reason).items())),
        {tier: float(np.mean([r.bytes.get(tier, 0) for r in records])) for tier in tiers},
    )


def interval(values: Sequence[float]) -> Interval:
    """The mean and its percentile bootstrap over episodes (Efron 1979), always the same draws."""
    data = np.asarray(values, dtype=np.float64)
    low, high = np.percentile(_means(data), [2.5, 97.5])
    return Interval(float(data.mean()), float(low), float(high))


class Paired(NamedTuple):
    """Differences in points over the episodes that two runs both played. ``times_ours``: their SPL over ours, None where
    ours may be 0."""

    pairs: int
    sr: Interval
    spl: Interval
    times_ours: Interval | None


def paired(ours: Sequence[EpisodeRecord], theirs: Sequence[EpisodeRecord]) -> Paired | None:
    """Ours minus theirs; None: they have no episode in common."""
    by_key = {r.key: r for r in theirs}
    pairs = [(r, by_key[r.key]) for r in ours if r.key in by_key]
    if not pairs:
        return None
    return Paired(
        len(pairs),
        interval([100.0 * (float(a.success) - float(b.success)) for a, b in pairs]),
        interval([100.0 * (a.spl - b.spl) for a, b in pairs]),
        _ratio(np.array([(b.spl, a.spl) for a, b in pairs])),
    )


def _ratio(spl: NDArray[np.float64]) -> Interval | None:
    """The mean of the first column (N, 2) over that of the second, and its interval: pairs are drawn, so it is a ratio of the
    same searches. None: no bound can be given."""
    over, under = _means(spl).T
    if (under > 0.0).mean() < 0.99:
        return None
    low, high = np.percentile(np.divide(over, under, out=np.full_like(over, np.inf), where=under > 0.0), [2.5, 97.5])
    return Interval(float(spl[:, 0].mean() / spl[:, 1].mean()), float(low), float(high))


def _means(data: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of resampled rows: (``RESAMPLES``, ...)."""
    rng = np.random.default_rng(0)
    chunk = max(1, 4_000_000 // len(data))
    parts = []
    for first in range(0, RESAMPLES, chunk):
        n = min(chunk, RESAMPLES - first)
        parts.append(data[rng.integers(len(data), size=(n, len(data)))].mean(axis=1))
    return np.concatenate(parts)
