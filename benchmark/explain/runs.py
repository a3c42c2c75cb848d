"""The runs that a page explains: read, checked, and the differences between two of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from surveilnav.benchmark.explain.loss import losses
from surveilnav.benchmark.runner.records import SETTINGS_FILE, VERSION, read, read_facts
from surveilnav.benchmark.runner.row import EXPLAINING, EpisodeRecord
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.benchmark.runner.summary import Interval, Paired, intervals, paired, pairs_of
from surveilnav.errors import ConfigError


@dataclass(frozen=True, slots=True)
class ExplainableRun:
    """A run whose rows say how near each search came to a goal; at least one search. ``facts``: of its ``settings.json``."""

    folder: Path
    facts: Mapping[str, Any]
    records: Sequence[EpisodeRecord]

    @classmethod
    def read(cls, folder: Path) -> ExplainableRun:
        """ConfigError: there is no run, nothing was played of it, or it was played by a program that didn't say enough."""
        records, facts = read(folder), read_facts(folder)
        assert facts is not None  # ``read`` has seen them
        if facts["version"] != VERSION:
            raise ConfigError(
                f"the run {folder} can't be explained: it was played before rows had the columns {', '.join(EXPLAINING)}. "
                f"Play it again into another folder (--out), with the settings of {folder / SETTINGS_FILE}"
            )
        if not records:
            raise ConfigError(
                f"the run {folder} holds no search yet: play it with `surveilnav bench run --out {folder}`"
            )
        return cls(folder, facts, records)

    @property
    def settings(self) -> dict[str, Any]:
        """All settings, also those that have their defaults."""
        return {**msgspec.to_builtins(RunSettings()), **self.facts["settings"]}

    def settings_beside(self, other: Mapping[str, Any]) -> str:
        """The settings that others don't have, in words."""
        own = self.settings
        differing = [f"{name.replace('_', ' ')} {_in_words(own[name])}" for name in own if own[name] != other.get(name)]
        return ", ".join(differing)


@dataclass(frozen=True, slots=True)
class Gain:
    """What a bound has more than the run that is explained, in the searches of both.

    ``by_part``: how many points fewer it loses in each part of ``Loss``; they add up to the difference in SPL.
    """

    label: str
    bound: ExplainableRun
    difference: Paired
    by_part: tuple[Interval, ...]


def gain_of(bound: ExplainableRun, run: ExplainableRun) -> Gain:
    """ConfigError: the two have no search in common."""
    if bound.facts["dataset"] != run.facts["dataset"]:
        raise ConfigError(f"{bound.folder} is no bound of {run.folder}: it was played on another dataset or split")
    pairs = pairs_of(bound.records, run.records)
    difference = paired(pairs)
    if difference is None:
        raise ConfigError(f"{bound.folder} and {run.folder} have no search in common")
    fewer = losses([own for _, own in pairs]) - losses([its for its, _ in pairs])
    label = bound.settings_beside(run.settings) or "the same settings"
    if bound.facts["program"] != run.facts["program"]:
        label += f" (program {str(bound.facts['program'])[:12]})"
    return Gain(label, bound, difference, tuple(intervals(np.asarray(fewer), [its.scene for its, _ in pairs])))


def _in_words(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return str(value) if value not in ("", [], {}) else "none"
