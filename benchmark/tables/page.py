"""A table's page: markdown and a plot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any

from surveilnav.benchmark.dataset.splits import EDITION, is_real_home
from surveilnav.benchmark.play.episode import REASONS
from surveilnav.benchmark.runner.basis import Basis
from surveilnav.benchmark.runner.row import EpisodeRecord
from surveilnav.benchmark.runner.summary import (
    SUCCESS_RULE,
    WITHIN_M,
    Interval,
    Summary,
    paired,
    pairs_of,
    parts,
    summarise,
)
from surveilnav.benchmark.tables.arms import Arm, Table

#: Categories of which there are so few furniture models that one of them may decide a number.
FEW_MODELS = ("toilet", "tv")


@dataclass(frozen=True, slots=True)
class TableRow:
    """One arm of a table with its episodes, at least one. The others are compared with the row of the first arm."""

    arm: Arm
    records: Sequence[EpisodeRecord]
    summary: Summary

    @classmethod
    def from_records(cls, arm: Arm, records: Sequence[EpisodeRecord]) -> TableRow:
        return cls(arm, records, summarise(records))


def page(
    table: Table,
    rows: Sequence[TableRow],
    total: int,
    models: Mapping[tuple[str, str], Sequence[str]],
    basis: Basis,
    edition: str = EDITION,
) -> str:
    """A table's page.

    Args:
        total: episodes of the split.
        models: by scene and category, the furniture models of its goals.
    """
    apart = " and ".join(f"{m:g} m" for m in WITHIN_M)
    text = [
        f"# {table.title}",
        "",
        f"Made by `surveilnav bench table {table.name}`, program `{basis.program[:12]}`, dataset "
        f"{edition} `{basis.dataset[:12]}`. {table.about}",
        "",
        f"Split `{table.arms[0].settings.split}`, {total} episodes. Success: {SUCCESS_RULE}. SR at {apart}: if a stop so "
        "far from a viewpoint counted. SoftSPL: the share of the way to the goal that was gone counts instead of success. "
        "Means in percent with 95 % bootstrap intervals: whole scenes are drawn, with all their searches; the luck of "
        "`simulated` isn't in them (another seed may move the SR of 60 searches by 5 points). "
        "Differences are a line's minus the first line's, paired by episode, in points; beside them the first line's SPL "
        "over the line's own (left out where that may be 0). MB: what the cameras sent in an episode, by tier: frames "
        "of those that were invoked, and in buildings of several floors summaries of all. What the paper has "
        "was measured on other buildings. Every policy that explores knows that the floor it starts on has a goal (Habitat's "
        "rule for starts). Where no real detector looks, depth and instance ids have half the resolution: 320x240 of the "
        "robot, 640x640 of a camera.",
        "",
        *_comparison(table, rows, total),
    ]
    if rows:
        text += ["", f"![]({table.name}.png)"]
        if table.factors:
            text += ["", "## By factor", "", *_factors(table, rows)]
        if table.explained:
            text += ["", "## Which searches make the difference", "", *_parts(rows)]
        text += ["", "## Real homes and generated buildings", "", *_by_origin(rows)]
        text += ["", "## Why searches failed", "", *_reasons(rows)]
        text += ["", "## By category", "", "SR / SPL (searches).", "", *_by(rows, lambda r: r.category)]
        text += [
            "",
            "## By furniture model",
            "",
            "Of categories that have few: by the models that a scene's goals are made of.",
            "",
        ]
        text += _by(rows, lambda r: _models(r, models))
        if table.name == "main":
            text += ["", "## By scene", "", *_by(rows[:2], lambda r: r.scene)]
    return "\n".join(text) + "\n"


def _comparison(table: Table, rows: Sequence[TableRow], total: int) -> list[str]:
    """A row for every arm, played or not."""
    first = next((row for row in rows if row.arm is table.arms[0]), None)
    tiers = sorted({tier for row in rows for tier in row.summary.bytes})
    with_paper = any(arm.paper for arm in table.arms)
    columns = ["", "episodes", "SR", "SPL", "SoftSPL", "SR difference", "SPL difference", "first's SPL / its"]
    columns += [f"SR at {m:g} m" for m in WITHIN_M] + ["steps", "path [m]"]
    columns += [f"{tier} [MB]" for tier in tiers] + ["paper, on another dataset: SR / SPL"] * with_paper
    text = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    for row in rows:
        arm, s = row.arm, row.summary
        difference = ("", "", "") if first is None or row is first else _difference(row, first)
        cells = [
            arm.label,
            f"{s.episodes}" + (" (unfinished)" if s.episodes < total * arm.seeds else ""),
            str(s.sr),
            str(s.spl),
            f"{s.soft_spl.mean:.1f}",
            *difference,
            *(f"{s.sr_within[m]:.1f}" for m in WITHIN_M),
            f"{s.steps:.0f}",
            f"{s.path_m:.1f}",
        ]
        cells += [f"{s.bytes.get(tier, 0.0) / 1e6:.3g}" for tier in tiers]
        if with_paper:
            cells.append(f"{arm.paper[0]:.1f} / {arm.paper[1]:.1f}" if arm.paper else "")
        text.append("| " + " | ".join(cells) + " |")
    missing = [arm for arm in table.arms if all(row.arm is not arm for row in rows)]
    return text + ["| " + " | ".join([arm.label, "0", *[""] * (len(columns) - 2)]) + " |" for arm in missing]


def _difference(row: TableRow, first: TableRow) -> tuple[str, str, str]:
    """SR and SPL against the first line's, and that one's SPL over this one's; of how many episodes, where these aren't
    all."""
    if (found := paired(pairs_of(row.records, first.records))) is None:
        return "", "", ""
    all_paired = found.pairs == row.summary.episodes == first.summary.episodes * row.arm.seeds
    of = "" if all_paired else f" (of {found.pairs})"
    r = found.ratio
    ratio = f"{r.mean:.2f} [{r.low:.2f}, {r.high:.2f}]{of}" if r else ""
    return found.sr.signed() + of, found.spl.signed() + of, ratio


def _factors(table: Table, rows: Sequence[TableRow]) -> list[str]:
    """A row for every level of every factor, of all lines that have it."""
    text = [
        "All lines with the level; differences are to the lines that have the factor's first level and are the same in all "
        "else, paired by episode.",
        "",
        "| | lines | SR | SPL | SR difference | SPL difference |",
        "|" + "---|" * 6,
    ]
    of = {row.arm.levels: row.records for row in rows}
    for i, factor in enumerate(table.factors):
        first = table.arms[0].levels[i]
        for level in dict.fromkeys(arm.levels[i] for arm in table.arms):
            own = {levels: records for levels, records in of.items() if levels[i] == level}
            if not own:
                continue
            s, difference = summarise([r for records in own.values() for r in records]), ("", "")
            if level != first:
                beside = {levels: of.get((*levels[:i], first, *levels[i + 1 :]), ()) for levels in own}
                pairs = [pair for levels, records in own.items() for pair in pairs_of(records, beside[levels])]
                if found := paired(pairs):
                    difference = found.sr.signed(), found.spl.signed()
            cells = [f"{factor}: {level}", str(len(own)), str(s.sr), str(s.spl), *difference]
            text.append("| " + " | ".join(cells) + " |")
    return text


def _by_origin(rows: Sequence[TableRow]) -> list[str]:
    """Homes that people drew apart from buildings of our generator: SR, SPL and the difference to the first line."""
    text = ["| | buildings | searches | SR | SPL | SR difference | SPL difference |", "|" + "---|" * 7]
    for real, name in ((True, "real homes"), (False, "generated")):
        for row in rows:
            some = [r for r in row.records if is_real_home(r.scene) == real]
            if not some:
                continue
            s, difference = summarise(some), ("", "")
            if row is not rows[0] and (found := paired(pairs_of(some, rows[0].records))) is not None:
                difference = found.sr.signed(), found.spl.signed()
            cells = [row.arm.label, name, str(s.episodes), str(s.sr), str(s.spl), *difference]
            text.append("| " + " | ".join(cells) + " |")
    return text


def _parts(rows: Sequence[TableRow]) -> list[str]:
    """By which searches a line's SPL differs from the first's: points of all pairs, and how many searches."""
    text = [
        "A line's SPL minus the first line's, in points of all searches that both have; in brackets how many searches they are.",
        "",
        "| | only it succeeds | only the first succeeds | both, its SPL higher | both, its SPL lower | together |",
        "|" + "---|" * 6,
    ]
    why = []
    for row in rows[1:]:
        if not (pairs := pairs_of(row.records, rows[0].records)):
            continue
        found = parts(pairs)
        cells = [f"{part.spl:+.1f} ({part.pairs})" for part in found]
        text.append("| " + " | ".join([row.arm.label, *cells, f"{sum(p.spl for p in found):+.1f}"]) + " |")
        why += [
            f"- Why the first fails where only {row.arm.label} succeeds: {_counted(found.line_alone.reasons)}.",
            f"- Why {row.arm.label} fails where only the first succeeds: {_counted(found.first_alone.reasons)}.",
        ]
    return [*text, "", *why]


def _counted(reasons: Mapping[str, int]) -> str:
    return ", ".join(f"`{name}` {n}" for name, n in reasons.items()) or "it never does"


def _models(record: EpisodeRecord, models: Mapping[tuple[str, str], Sequence[str]]) -> str | None:
    """A category with its models in the record's scene; None: it has many."""
    if record.category not in FEW_MODELS:
        return None
    return f"{record.category}: {', '.join(models[record.scene, record.category])}"


def _reasons(rows: Sequence[TableRow]) -> list[str]:
    names = list(REASONS)
    text = ["| | " + " | ".join(names) + " |", "|" + "---|" * (len(names) + 1)]
    for row in rows:
        s = row.summary
        counts = (f"{s.reasons[n]} ({s.seen.get(n, 0)})" if n in s.reasons else "0" for n in names)
        text.append(f"| {row.arm.label} | " + " | ".join(counts) + " |")
    text += ["", "In brackets: of these, where an object that some view called the target lay in the maps at a goal."]
    return text + [""] + [f"- `{n}`: {REASONS[n]}" for n in names]


def _by(rows: Sequence[TableRow], group: Callable[[EpisodeRecord], str | None]) -> list[str]:
    """SR / SPL by group; records without one are left out."""
    names = sorted({name for row in rows for r in row.records if (name := group(r)) is not None})
    text = ["| | " + " | ".join(row.arm.label for row in rows) + " |", "|" + "---|" * (len(rows) + 1)]
    for name in names:
        cells = []
        for row in rows:
            some = [r for r in row.records if group(r) == name]
            n = len(some)
            cells.append(
                f"{100 * sum(r.success for r in some) / n:.0f} / {100 * sum(r.spl for r in some) / n:.0f} ({n})"
                if n
                else ""
            )
        text.append(f"| {name} | " + " | ".join(cells) + " |")
    return text


def plot(table: Table, rows: Sequence[TableRow], file: IO[bytes]) -> None:
    """SR and SPL of every arm with their intervals, as bars, and SPL over the cameras' bytes if the table asks; PNG."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    size = (10, 1.2 + 0.38 * len(rows))
    if table.over_bytes:
        figure = plt.figure(figsize=(size[0], size[1] + 3.2), layout="constrained")
        above, below = figure.subfigures(2, 1, height_ratios=(size[1], 3.2))
        _over_bytes(rows, below.subplots())
    else:
        figure = plt.figure(figsize=size, layout="constrained")
        above = figure
    for axis, name in zip(above.subplots(1, 2, sharey=True), ("sr", "spl"), strict=True):
        values: list[Interval] = [getattr(row.summary, name) for row in rows]
        at = range(len(rows), 0, -1)
        means = [v.mean for v in values]
        errors = [[v.mean - v.low for v in values], [v.high - v.mean for v in values]]
        colors = ["#2a6f97" if i == 0 else "#a9c6d8" for i in range(len(rows))]
        axis.barh(list(at), means, xerr=errors, color=colors, error_kw={"elinewidth": 1, "capsize": 2})
        axis.set_yticks(list(at), [row.arm.label for row in rows])
        axis.set_xlabel("SR [%]" if name == "sr" else "SPL [%]")
        axis.set_xlim(0, 100)
        axis.spines[["top", "right"]].set_visible(False)
    figure.suptitle(table.title)
    figure.savefig(file, format="png", dpi=110, metadata={"Software": ""})
    plt.close(figure)


def _over_bytes(rows: Sequence[TableRow], axis: Any) -> None:
    """SPL over the bytes of all tiers, a point for every arm."""
    for i, row in enumerate(rows):
        spl, sent_mb = row.summary.spl, sum(row.summary.bytes.values()) / 1e6
        error = [[spl.mean - spl.low], [spl.high - spl.mean]]
        axis.errorbar(sent_mb, spl.mean, yerr=error, fmt="o", capsize=2, color="#2a6f97" if i == 0 else "#6a9ab5")
        axis.annotate(row.arm.label, (sent_mb, spl.mean), xytext=(6, 4), textcoords="offset points", fontsize=8)
    axis.set_xlabel("sent by cameras in an episode [MB]")
    axis.set_ylabel("SPL [%]")
    axis.margins(x=0.25)
    axis.spines[["top", "right"]].set_visible(False)
