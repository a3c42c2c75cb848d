"""The picture of results in the README, from published runs.

python -m surveilnav.benchmark.tables.readme docs/images/results.png    # make docs
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO

from surveilnav.benchmark.runner.basis import Basis
from surveilnav.benchmark.runner.records import read_facts, stored_run
from surveilnav.benchmark.runner.settings import run_id
from surveilnav.benchmark.tables.arms import TABLES, Arm
from surveilnav.benchmark.tables.page import TableRow
from surveilnav.errors import ConfigError

PUBLISHED = Path("docs/results/bench/v1/records")
#: Okabe and Ito's colours, which people with any colour vision can tell apart.
_OURS, _OUR_VERIFICATION, _OWN_RULE = "#0072B2", "#56B4E9", "#999999"
#: By the arm of the table ``main``: what the README calls it, and its colour.
BARS: dict[str, tuple[str, str]] = {
    "ours, with surveillance, FMM": ("ours, with cameras", _OURS),
    "ours, without surveillance, FMM": ("ours, without cameras", _OURS),
    "nearest frontier": ("nearest frontier, our verification", _OUR_VERIFICATION),
    "VLFM's rule, our verification": ("VLFM's frontiers, our verification", _OUR_VERIFICATION),
    "ApexNav's rule": ("ApexNav's rule", _OWN_RULE),
    "L3MVN's rule": ("L3MVN's rule", _OWN_RULE),
    "VLFM's rule": ("VLFM's rule", _OWN_RULE),
}
_MEANINGS = {
    _OURS: "ours",
    _OUR_VERIFICATION: "explores by its own rule, verifies as ours",
    _OWN_RULE: "explores and verifies by its own rule",
}


def published(folder: Path = PUBLISHED) -> Iterator[TableRow]:
    """The arms of ``BARS`` with their published searches, in the order of the bars.

    Raises:
        ConfigError: a run isn't there, or is of other settings.
    """
    arms: dict[str, Arm] = {arm.label: arm for arm in TABLES["main"].arms}
    for label in BARS:
        arm = arms[label]
        run = folder / run_id(arm.settings)
        facts = read_facts(run)
        found = facts and stored_run(run, arm.settings, Basis(facts["dataset"], facts["program"]))
        if not found:
            raise ConfigError(f"expected the published run of {label!r} in {run}, found none")
        yield TableRow.from_records(arm, found.records)


def plot(rows: Sequence[TableRow], file: IO[bytes]) -> None:
    """Success and SPL of the bars, with their 95 % intervals; PNG."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.patches import Patch

    names, colours = zip(*(BARS[row.arm.label] for row in rows), strict=True)
    at = range(len(rows), 0, -1)
    figure = plt.figure(figsize=(9.5, 3.6), layout="constrained")
    for axis, name in zip(figure.subplots(1, 2, sharey=True), ("sr", "spl"), strict=True):
        values = [getattr(row.summary, name) for row in rows]
        errors = [[v.mean - v.low for v in values], [v.high - v.mean for v in values]]
        axis.barh(
            list(at), [v.mean for v in values], xerr=errors, color=colours, error_kw={"elinewidth": 1, "capsize": 2}
        )
        for y, v in zip(at, values, strict=True):
            axis.annotate(f"{v.mean:.1f}", (v.high, y), xytext=(5, 0), textcoords="offset points", va="center")
        axis.set_yticks(list(at), names)
        axis.set_xlabel("searches that succeed [%]" if name == "sr" else "SPL [%]: success, weighted by path length")
        axis.set_xlim(0, 100)
        axis.spines[["top", "right"]].set_visible(False)
    handles = [Patch(color=colour, label=meaning) for colour, meaning in _MEANINGS.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize="small")
    figure.savefig(file, format="png", dpi=110, metadata={"Software": ""})
    plt.close(figure)


if __name__ == "__main__":
    with Path(sys.argv[1]).open("wb") as out:
        plot(list(published()), out)
