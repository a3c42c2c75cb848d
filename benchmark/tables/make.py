"""Making a table: its runs, then its page; whatever is there already isn't played again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from benchmark.dataset import format as files
from benchmark.dataset.format import SceneRecord
from benchmark.dataset.load import scenes_of
from benchmark.runner.basis import basis_of
from benchmark.runner.records import Records
from benchmark.runner.run import Progress, run
from benchmark.tables.arms import Table
from benchmark.tables.page import Line, page, plot


class Made(NamedTuple):
    """A table's page, and what is missing of it: ``faults`` name scenes and episodes that aren't counted."""

    page: Path
    faults: list[str]
    complete: bool


def make(
    table: Table,
    root: Path,
    out: Path,
    *,
    workers: int,
    on_progress: Callable[[int, int, str], None] = lambda done, total, arm: None,
) -> Made:
    """Writes ``<out>/<table>.md`` and ``.png``, anew after every arm; runs are kept in ``<out>/runs``.

    Raises:
        ConfigError: settings, dataset or records that can't be used.
    """
    lines, faults, models, complete = [], [], models_of(root, table.arms[0].settings.split), True
    path = out / f"{table.name}.md"
    if begun := [arm for arm in table.arms if (out / "runs" / arm.slug).exists()]:
        basis = basis_of(root, table.arms[0].settings.split)
        for arm in begun:  # a folder that can't be used is said before hours are spent on another
            Records(out / "runs" / arm.slug, arm.settings, basis)
    for number, arm in enumerate(table.arms, start=1):

        def report(p: Progress, before: int = number - 1, label: str = arm.label) -> None:
            on_progress(before * p.total + p.done, len(table.arms) * p.total, f"{table.name}: {label}")

        finished = run(root, out / "runs" / arm.slug, arm.settings, workers=workers, on_progress=report)
        complete &= finished.complete
        faults += [f"{arm.label}: {scene} could not be played: {why}" for scene, why in finished.unopened.items()]
        faults += [
            f"{arm.label}: {b.scene} episode {b.episode_id} broke: {b.error.strip().splitlines()[-1]}"
            for b in finished.broken
        ]
        if finished.records:
            lines.append(Line.of(arm, finished.records))
            plot(table, lines, path.with_suffix(".png"))
        text = page(table, lines, finished.total, models)
        text += "\n## Not counted\n\n" + "\n".join(f"- {f}" for f in faults) + "\n" if faults else ""
        path.write_text(text)
    return Made(path, faults, complete)


def models_of(root: Path, split: str) -> dict[tuple[str, str], list[str]]:
    """By scene and category, the furniture models that its goals are made of. ConfigError: a file is missing or damaged."""
    records = (files.read(root / split / "scenes" / f"{name}.json", SceneRecord) for name in scenes_of(root, split))
    return {(r.scene, label): models for r in records for label, models in r.target_models.items()}
