"""A table's page: markdown and a plot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmark.episode import REASONS
from benchmark.runner.basis import program_hash
from benchmark.runner.records import EpisodeRecord
from benchmark.runner.summary import SUCCESS_RULE, Interval, Summary, paired, summarise
from benchmark.tables.arms import Arm, Table

Played = Sequence[tuple[Arm, Sequence[EpisodeRecord]]]


def page(table: Table, played: Played, total: int) -> str:
    """``played``: arms with at least one episode; ``total``: episodes of the split."""
    rows = [(arm, records, summarise(records)) for arm, records in played]
    first = rows[0]
    with_bytes = any(s.bytes for _, _, s in rows)
    lines = [
        f"# {table.title}", "",
        f"Made by `surveilnav bench table {table.name}`, program `{program_hash()[:12]}`. {table.about}", "",
        f"Split `{first[0].settings.split}`, {total} episodes. Success: {SUCCESS_RULE}. Means in percent with 95 % bootstrap "
        "intervals; differences are paired by episode, in points, to the first line.", "",
    ]  # fmt: skip
    columns = ["", "episodes", "SR", "SPL", "SoftSPL", "SR difference", "SPL difference", "steps", "path [m]"]
    columns += ["camera MB an episode"] * with_bytes + ["paper: SR / SPL"] * any(arm.paper for arm, _, _ in rows)
    lines += ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    for arm, records, s in rows:
        difference = ("", "") if records is first[1] else tuple(_signed(d) for d in paired(records, first[1]))
        cells = [
            arm.label, f"{s.episodes}" + (" (unfinished)" if s.episodes < total else ""), str(s.sr), str(s.spl),
            f"{s.soft_spl.mean:.1f}", *difference, f"{s.steps:.0f}", f"{s.path_m:.1f}",
        ]  # fmt: skip
        if with_bytes:
            cells.append(f"{sum(s.bytes.values()) / 1e6:.1f}" if s.bytes else "0.0")
        if any(a.paper for a, _, _ in rows):
            cells.append(f"{arm.paper[0]:.1f} / {arm.paper[1]:.1f}" if arm.paper else "")
        lines.append("| " + " | ".join(cells) + " |")
    lines += ["", f"![]({table.name}.png)", "", "## Why searches failed", "", *_reasons(rows)]
    lines += ["", "## By category", "", *_by(rows, "category")]
    if table.name == "main":
        lines += ["", "## By scene", "", *_by(rows[:2], "scene")]
    return "\n".join(lines) + "\n"


def _signed(i: Interval) -> str:
    return f"{i.mean:+.1f} [{i.low:+.1f}, {i.high:+.1f}]"


def _reasons(rows: Sequence[tuple[Arm, Sequence[EpisodeRecord], Summary]]) -> list[str]:
    names = [name for name in REASONS if any(name in s.reasons for _, _, s in rows)]
    lines = ["| | " + " | ".join(names) + " |", "|" + "---|" * (len(names) + 1)]
    for arm, _, s in rows:
        lines.append(f"| {arm.label} | " + " | ".join(str(s.reasons.get(n, 0)) for n in names) + " |")
    return lines + [""] + [f"- `{n}`: {REASONS[n]}" for n in names]


def _by(rows: Sequence[tuple[Arm, Sequence[EpisodeRecord], Summary]], field: str) -> list[str]:
    """SR / SPL by category or scene."""
    names = sorted({getattr(r, field) for _, records, _ in rows for r in records})
    lines = ["| | " + " | ".join(arm.label for arm, _, _ in rows) + " |", "|" + "---|" * (len(rows) + 1)]
    for name in names:
        cells = []
        for _, records, _ in rows:
            some = [r for r in records if getattr(r, field) == name]
            n = len(some)
            cells.append(
                f"{100 * sum(r.success for r in some) / n:.0f} / {100 * sum(r.spl for r in some) / n:.0f} ({n})"
                if n
                else ""
            )
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return lines


def plot(table: Table, played: Played, path: Path) -> None:
    """SR and SPL of every arm with their intervals, as bars."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    rows = [(arm.label, summarise(records)) for arm, records in played]
    figure, axes = plt.subplots(1, 2, figsize=(10, 1.2 + 0.38 * len(rows)), sharey=True, layout="constrained")
    for axis, name in zip(axes, ("sr", "spl"), strict=True):
        values: list[Interval] = [getattr(s, name) for _, s in rows]
        at = range(len(rows), 0, -1)
        means = [v.mean for v in values]
        errors = [[v.mean - v.low for v in values], [v.high - v.mean for v in values]]
        colors = ["#2a6f97" if i == 0 else "#a9c6d8" for i in range(len(rows))]
        axis.barh(list(at), means, xerr=errors, color=colors, error_kw={"elinewidth": 1, "capsize": 2})
        axis.set_yticks(list(at), [label for label, _ in rows])
        axis.set_xlabel("SR [%]" if name == "sr" else "SPL [%]")
        axis.set_xlim(0, 100)
        axis.spines[["top", "right"]].set_visible(False)
    figure.suptitle(table.title)
    figure.savefig(path, dpi=110, metadata={"Software": ""})
    plt.close(figure)
