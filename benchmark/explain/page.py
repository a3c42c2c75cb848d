"""The page of ``surveilnav bench explain``: where the SPL of a run is lost, in words and tables."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.benchmark.explain.groups import GROUPINGS, Grouping
from surveilnav.benchmark.explain.loss import NAMES, Loss, losses
from surveilnav.benchmark.explain.runs import ExplainableRun, Gain
from surveilnav.benchmark.play.approach import NEAR_M
from surveilnav.benchmark.play.episode import REASONS
from surveilnav.benchmark.runner.row import EpisodeRecord
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.benchmark.runner.summary import SUCCESS_RULE, Interval, intervals, summarise

#: What each part of ``Loss`` is, for people.
_MEANINGS: dict[str, str] = {
    "never_near": "the search failed, and the robot never was near a goal",
    "failed_near": "the search failed, although the robot was near a goal",
    "before": "of searches that succeed: what was driven too far until the robot first was near a goal",
    "left_again": "of searches that succeed: what was driven too far from then until it came near a goal for the last time",
    "last_approach": "of searches that succeed: what was driven too far from there to the stop",
}
_PART_NAMES = [NAMES[name][0] for name in Loss._fields]
#: A part of fewer points isn't spoken of.
_WORTH_SAYING = 0.05


def headline(records: Sequence[EpisodeRecord]) -> str:
    """One sentence that says where the points are lost, the largest part first."""
    points = losses(records).mean(axis=0)
    told = [(value, NAMES[name][1]) for name, value in zip(Loss._fields, points.tolist(), strict=True)]
    told = sorted((t for t in told if t[0] >= _WORTH_SAYING), key=lambda t: -t[0])
    if not told:
        return f"Nothing is lost: the SPL of these {len(records)} searches is {100.0 - points.sum():.1f}."
    parts = [f"{value:.1f} {'go ' if i == 0 else ''}{phrase}" for i, (value, phrase) in enumerate(told)]
    listed = parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
    return f"Of the {points.sum():.1f} points that are missing to an SPL of 100, {listed}."


def page(run: ExplainableRun, gains: Sequence[Gain], picture: str) -> str:
    """The page. ``picture``: the name of the file beside it."""
    records, facts = run.records, run.facts
    s = summarise(records)
    changed = run.settings_beside(msgspec.to_builtins(RunSettings())) or "none"
    text = [
        f"# Where SPL is lost: {run.folder.name}",
        "",
        f"**{headline(records)}**",
        "",
        f"Made by `surveilnav bench explain` from {s.episodes} searches: SR {s.sr}, SPL {s.spl}. Settings that aren't the "
        f"defaults: {changed}. Program `{facts['program'][:12]}`, dataset `{facts['dataset'][:12]}`.",
        "",
        f"Success: {SUCCESS_RULE}. The SPL of a search is the length of the shortest path over the length of the robot's path, "
        "and 0 for a failure. A robot is *near* a goal while the shortest path to the nearest viewpoint of any goal is at most "
        f"{NEAR_M:g} m. Numbers are points of SPL with 95 % bootstrap intervals: whole scenes are drawn, with all their "
        "searches.",
        "",
        f"![Where SPL is lost]({picture})",
        "",
        "## The parts",
        "",
        *_parts(records),
        "",
        "They add up to what is missing. A metre that a search drives too far costs it 1 / (its path) of an SPL of 1; "
        "`benchmark/explain/loss.py` has the formulas.",
    ]
    if failures := [r for r in records if not r.success]:
        text += ["", "## Failures by reason", "", *_failures(failures, len(records))]
    missing = losses(records).sum()
    for grouping in GROUPINGS:
        text += ["", f"## {grouping.title}", "", grouping.about, "", *_groups(grouping, records, missing)]
    text += ["", "## Headroom", "", *_headroom(gains)]
    return "\n".join(text) + "\n"


def _parts(records: Sequence[EpisodeRecord]) -> list[str]:
    points = losses(records)
    missing = points.sum()
    rows = []
    for name, column, i in zip(Loss._fields, points.T, _intervals(points, records), strict=True):
        share = f"{column.sum() / missing:.0%}" if missing else ""
        rows.append([NAMES[name][0], _count(column), str(i), share, _MEANINGS[name]])
    whole = intervals(points.sum(axis=1, keepdims=True), [r.scene for r in records])[0]
    rows.append(["together", _count(points.sum(axis=1)), str(whole), "100%" if missing else "", ""])
    return _table(["", "searches", "points", "share", "what it is"], rows)


def _count(points: NDArray[np.float64]) -> str:
    """How many searches lose anything that shows."""
    return str(int((points >= _WORTH_SAYING).sum()))


def _failures(failures: Sequence[EpisodeRecord], of: int) -> list[str]:
    rows = []
    for reason in REASONS:
        some = [r for r in failures if r.reason == reason]
        near = sum(bool(r.approach and r.approach.came_near) for r in some)
        if some:
            far = len(some) - near
            rows.append(
                [f"`{reason}`", f"{100 * far / of:.1f} ({far})", f"{100 * near / of:.1f} ({near})", REASONS[reason]]
            )
    return [
        "Points, and in brackets how many searches.",
        "",
        *_table(["", "never near", "near", "what it means"], rows),
    ]


def _groups(grouping: Grouping, records: Sequence[EpisodeRecord], missing: float) -> list[str]:
    """A row for each group. ``missing``: what all searches together lose."""
    rows = []
    for name, some in grouping.groups(records).items():
        s, points = summarise(some), losses(some)
        share = f"{points.sum() / missing:.0%}" if missing else ""
        rows.append([name, str(s.episodes), str(s.sr), str(s.spl), share, *map(str, _intervals(points, some))])
    return _table(["", "searches", "SR", "SPL", "of all that is missing", *_PART_NAMES], rows)


def _headroom(gains: Sequence[Gain]) -> list[str]:
    if not gains:
        return [
            "No bound was named. `surveilnav bench run --policy perfect-frontiers` plays these searches with a perfect choice of "
            "frontiers, and `--camera-perception oracle` with a perfect detector on the cameras alone; all other options as in "
            "this run. `surveilnav bench explain RUN --bound BOUND` then says here what that gains."
        ]
    rows = []
    for gain in gains:
        s, d = summarise(gain.bound.records), gain.difference
        cells = [gain.label, str(d.pairs), f"{s.sr.mean:.1f} / {s.spl.mean:.1f}", d.sr.signed(), d.spl.signed()]
        rows.append([*cells, *(i.signed() for i in gain.by_part)])
    return [
        "What runs gain that differ from this one in what the first column says, paired by search. Bounds are no methods: they "
        "are told what a robot can't know, and show how much a better choice of frontiers or better eyes could bring at most. On "
        "the right: how many points fewer each part loses; together they are the difference in SPL.",
        "",
        *_table(["", "searches of both", "SR / SPL", "SR difference", "SPL difference", *_PART_NAMES], rows),
    ]


def _intervals(points: NDArray[np.float64], records: Sequence[EpisodeRecord]) -> list[Interval]:
    return intervals(points, [r.scene for r in records])


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = ["| " + " | ".join(cells) + " |" for cells in (header, *rows)]
    return [lines[0], "|" + "---|" * len(header), *lines[1:]]
