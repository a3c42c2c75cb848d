"""The picture of ``surveilnav bench explain``: for the whole run and for groups of it, the SPL and the parts that are missing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import IO, Any

from surveilnav.benchmark.explain.groups import GROUPINGS
from surveilnav.benchmark.explain.loss import NAMES, Loss, losses
from surveilnav.benchmark.explain.runs import ExplainableRun, Gain
from surveilnav.benchmark.runner.row import EpisodeRecord

#: Okabe and Ito's colours, which people with any colour vision can tell apart; in the order of a search.
_COLOURS = {
    "before": "#E69F00",
    "left_again": "#CC79A7",
    "last_approach": "#F0E442",
    "failed_near": "#D55E00",
    "never_near": "#7F7F7F",
}
_SPL_COLOUR = "#0072B2"
_ON_DARK = (_SPL_COLOUR, "#D55E00", "#7F7F7F")
#: A part of fewer points has no room for its number.
_ROOM_FOR_NUMBER = 4.0


def plot(run: ExplainableRun, gains: Sequence[Gain], file: IO[bytes]) -> None:
    """A bar of 100 points for all searches, for each bound that played them all, and for the groups; PNG."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    bars = list(_bars(run, gains))
    height = sum(0.62 if title else 0.34 for title, _, _ in bars)
    figure = plt.figure(figsize=(10, 1.4 + height), layout="constrained")
    axis, y, ticks = figure.subplots(), 0.0, {}
    for title, label, records in bars:
        if title:
            y -= 0.8
            axis.text(0.0, y + 0.62, title, fontsize="small", fontweight="bold", va="center")
        ticks[y] = f"{label} ({len(records)})"
        _bar(axis, y, records)
        y -= 1.0
    axis.set_yticks(list(ticks), list(ticks.values()), fontsize="small")
    axis.set_xlim(0, 100)
    axis.set_ylim(y + 0.4, 0.6)
    axis.set_xlabel("SPL and what is missing to 100, in points; in brackets the number of searches")
    axis.spines[["top", "right", "left"]].set_visible(False)
    axis.tick_params(axis="y", length=0)
    handles, names = axis.get_legend_handles_labels()
    first = dict(zip(names, handles, strict=True))
    figure.legend(first.values(), first.keys(), loc="outside upper center", ncols=6, frameon=False, fontsize="small")
    figure.savefig(file, format="png", dpi=110, metadata={"Software": ""})
    plt.close(figure)


def _bars(run: ExplainableRun, gains: Sequence[Gain]) -> Iterator[tuple[str, str, Sequence[EpisodeRecord]]]:
    """Title of a new group of bars or "", label, searches."""
    yield "", "this run", run.records
    for gain in gains:
        if gain.difference.pairs == len(run.records) == len(gain.bound.records):
            yield "", gain.label, gain.bound.records
    for grouping in GROUPINGS:
        if not grouping.in_picture:
            continue
        title = grouping.title
        for name, some in grouping.groups(run.records).items():
            yield title, name, some
            title = ""


def _bar(axis: Any, y: float, records: Sequence[EpisodeRecord]) -> None:
    points = dict(zip(Loss._fields, losses(records).mean(axis=0).tolist(), strict=True))
    segments = [("SPL", 100.0 - sum(points.values()), _SPL_COLOUR)]
    segments += [(NAMES[name][0], points[name], colour) for name, colour in _COLOURS.items()]
    left = 0.0
    for name, width, colour in segments:
        axis.barh(y, width, left=left, height=0.78, color=colour, label=name, edgecolor="white", linewidth=0.5)
        if width >= _ROOM_FOR_NUMBER:
            ink = "white" if colour in _ON_DARK else "black"
            axis.text(left + width / 2, y, f"{width:.0f}", ha="center", va="center", fontsize="x-small", color=ink)
        left += width
