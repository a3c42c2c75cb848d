"""From records to numbers: SR, SPL, SoftSPL in percent, with bootstrap intervals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surveilnav.benchmark.runner.row import EpisodeRecord
from surveilnav.simulator.world.goals import SUCCESS_M

RESAMPLES = 10_000
#: Failures of searches that ended with ``stop``.
_STOPPED = ("false_positive", "stopped_short")
#: How far [m] from a viewpoint a stop may be to count beside the success rule.
WITHIN_M = (0.2, 1.0)
SUCCESS_RULE = f"`stop` within {SUCCESS_M:g} m (geodesic) of a viewpoint of any goal (Habitat's rule)"


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean in percent, or a ratio of two, and its 95 % interval."""

    mean: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.mean:.1f} [{self.low:.1f}, {self.high:.1f}]"

    def signed(self) -> str:
        """As a difference is written."""
        return f"{self.mean:+.1f} [{self.low:+.1f}, {self.high:+.1f}]"


@dataclass(frozen=True, slots=True)
class Summary:
    """A run's numbers. ``sr_within``: the success rate in percent if ``stop`` may be so far [m] from a viewpoint, of
    ``WITHIN_M``. ``reasons``: failures by name; ``seen``: how many of them although an object of the target's class lay in
    the maps where a goal is."""

    episodes: int
    sr: Interval
    spl: Interval
    soft_spl: Interval
    sr_within: dict[float, float]
    steps: float
    path_m: float
    reasons: dict[str, int]
    seen: dict[str, int]
    bytes: dict[str, float]


def summarise(records: Sequence[EpisodeRecord]) -> Summary:
    """The numbers of at least one record. ValueError: none."""
    if not records:
        raise ValueError("there is no episode to sum up")
    scenes = [r.scene for r in records]
    tiers = sorted({tier for r in records for tier in r.bytes})
    return Summary(
        len(records),
        interval([100.0 * r.success for r in records], scenes),
        interval([100.0 * r.spl for r in records], scenes),
        interval([100.0 * r.soft_spl for r in records], scenes),
        {m: float(np.mean([100.0 * _stopped_within(r, m) for r in records])) for m in WITHIN_M},
        float(np.mean([r.steps for r in records])),
        float(np.mean([r.path_m for r in records])),
        dict(sorted(Counter(r.reason for r in records if r.reason).items())),
        dict(sorted(Counter(r.reason for r in records if r.reason and r.seen).items())),
        {tier: float(np.mean([r.bytes.get(tier, 0) for r in records])) for tier in tiers},
    )


def _stopped_within(record: EpisodeRecord, limit_m: float) -> bool:
    stopped = record.success or record.reason in _STOPPED
    return stopped and record.distance_m is not None and record.distance_m <= limit_m


def interval(values: Sequence[float], scenes: Sequence[str]) -> Interval:
    """The mean and its percentile bootstrap (Efron 1979), always the same draws: of whole scenes, because searches in one
    share its cameras and its furniture. Of a single scene, its searches are drawn."""
    return intervals(np.asarray(values, dtype=np.float64)[:, None], scenes)[0]


def intervals(data: NDArray[np.float64], scenes: Sequence[str]) -> list[Interval]:
    """As ``interval``, for each column of (N, columns)."""
    low, high = np.percentile(_means(data, scenes), [2.5, 97.5], axis=0)
    return [Interval(*map(float, column)) for column in zip(data.mean(axis=0), low, high, strict=True)]


class Paired(NamedTuple):
    """Differences in points over the episodes that two runs both played. ``ratio``: the first's SPL over the line's, None
    where that may be 0."""

    pairs: int
    sr: Interval
    spl: Interval
    ratio: Interval | None


def pairs_of(
    line: Iterable[EpisodeRecord], first: Iterable[EpisodeRecord]
) -> list[tuple[EpisodeRecord, EpisodeRecord]]:
    """A line's records, each with the first's of the same episode; those without one are left out."""
    by_key = {r.key: r for r in first}
    return [(r, by_key[r.key]) for r in line if r.key in by_key]


def paired(pairs: Sequence[tuple[EpisodeRecord, EpisodeRecord]]) -> Paired | None:
    """Of pairs of a line's record and the first's: the line's minus the first's. None: there is no pair."""
    if not pairs:
        return None
    scenes = [a.scene for a, _ in pairs]
    return Paired(
        len(pairs),
        interval([100.0 * (float(a.success) - float(b.success)) for a, b in pairs], scenes),
        interval([100.0 * (a.spl - b.spl) for a, b in pairs], scenes),
        _ratio(np.array([(b.spl, a.spl) for a, b in pairs]), scenes),
    )


class Part(NamedTuple):
    """Some of the episodes that two runs both played: how many, what they make of the difference in SPL in points of all
    pairs, and why the run that failed did, by name and how often."""

    pairs: int
    spl: float
    reasons: dict[str, int]


class Parts(NamedTuple):
    """The episodes that succeed in the line alone, in the first alone, and in both with the line's SPL higher or lower."""

    line_alone: Part
    first_alone: Part
    both_higher: Part
    both_lower: Part


def parts(pairs: Sequence[tuple[EpisodeRecord, EpisodeRecord]]) -> Parts:
    """Where the difference in SPL comes from: the line's minus the first's. The parts add up to the whole difference."""

    def part(chosen: Sequence[tuple[EpisodeRecord, EpisodeRecord]], reasons: Iterable[str] = ()) -> Part:
        spl = 100.0 * sum(a.spl - b.spl for a, b in chosen) / len(pairs)
        return Part(len(chosen), spl, dict(Counter(reasons).most_common()))

    line = [(a, b) for a, b in pairs if a.success and not b.success]
    first = [(a, b) for a, b in pairs if b.success and not a.success]
    both = [(a, b) for a, b in pairs if a.success and b.success]
    return Parts(
        part(line, (b.reason for _, b in line)),
        part(first, (a.reason for a, _ in first)),
        part([(a, b) for a, b in both if a.spl > b.spl]),
        part([(a, b) for a, b in both if a.spl < b.spl]),
    )


def _ratio(spl: NDArray[np.float64], scenes: Sequence[str]) -> Interval | None:
    """The mean of the first column (N, 2) over that of the second, and its interval: pairs are drawn, so it is a ratio of the
    same searches. None: no bound can be given."""
    over, under = _means(spl, scenes).T
    if (under > 0.0).mean() < 0.99:
        return None
    low, high = np.percentile(np.divide(over, under, out=np.full_like(over, np.inf), where=under > 0.0), [2.5, 97.5])
    return Interval(float(spl[:, 0].mean() / spl[:, 1].mean()), float(low), float(high))


def _means(data: NDArray[np.float64], scenes: Sequence[str]) -> NDArray[np.float64]:
    """Of rows (N, columns) resampled by scene: (``RESAMPLES``, columns)."""
    names, scene_of_row = np.unique(np.asarray(scenes), return_inverse=True)
    if len(names) == 1:
        scene_of_row = np.arange(len(data))
    n = int(scene_of_row.max()) + 1
    totals = np.zeros((n, data.shape[1]))
    np.add.at(totals, scene_of_row, data)
    drawn = np.random.default_rng(0).multinomial(n, np.full(n, 1 / n), size=RESAMPLES).astype(np.float64)
    means: NDArray[np.float64] = (drawn @ totals) / (drawn @ np.bincount(scene_of_row))[:, None]
    return means
