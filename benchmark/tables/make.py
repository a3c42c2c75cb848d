"""Making a table: its runs, then its page; whatever is there already isn't played again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from benchmark.dataset import format as files
from benchmark.dataset.format import SceneRecord
from benchmark.dataset.load import load_scene, scenes_of
from benchmark.runner.basis import basis_of
from benchmark.runner.records import Records
from benchmark.runner.run import Finished, Progress, run
from benchmark.tables.arms import Arm, Table
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
    wanted: Callable[[Arm], bool] = lambda arm: True,
    on_progress: Callable[[int, int, str], None] = lambda done, total, arm: None,
) -> Made:
    """Writes ``<out>/<table>.md`` and ``.png``, anew after every arm; runs are kept in ``<out>/runs``.

    Of arms that aren't ``wanted`` nothing is played: the page shows what is there.

    Raises:
        ConfigError: settings, dataset or records that can't be used.
    """
    lines, faults, models, complete = [], [], models_of(root, table.arms[0].settings.split), True
    path = out / f"{table.name}.md"
    there: dict[str, Records] = {}
    if begun := [arm for arm in table.arms if (out / "runs" / arm.slug).exists()]:
        basis = basis_of(root, table.arms[0].settings.split)
        for arm in begun:  # a folder that can't be used is said before hours are spent on another
            there[arm.slug] = Records(out / "runs" / arm.slug, arm.settings, basis)
    total = episodes_of(root, table.arms[0].settings.split)
    to_play = [arm for arm in table.arms if wanted(arm)]
    for arm in table.arms:

        def report(p: Progress, arm: Arm = arm) -> None:
            before = to_play.index(arm) * p.total
            on_progress(before + p.done, len(to_play) * p.total, f"{table.name}: {arm.label}")

        if arm in to_play:
            finished = run(root, out / "runs" / arm.slug, arm.settings, workers=workers, on_progress=report)
        elif arm.slug in there:
            finished = Finished(there[arm.slug].all(), there[arm.slug].broken(), {}, total)
        else:
            finished = Finished([], [], {}, total)
        complete &= finished.complete
        faults += [f"{arm.label}: {scene} could not be played: {why}" for scene, why in finished.unopened.items()]
        faults += [
            f"{arm.label}: {b.scene} episode {b.episode_id} broke: {b.error.strip().splitlines()[-1]}"
            for b in finished.broken
        ]
        if finished.records:
            lines.append(Line.of(arm, finished.records))
            plot(table, lines, path.with_suffix(".png"))
        text = page(table, lines, total, models)
        text += "\n## Not counted\n\n" + "\n".join(f"- {f}" for f in faults) + "\n" if faults else ""
        path.write_text(text)
    return Made(path, faults, complete)


def episodes_of(root: Path, split: str) -> int:
    """How many a split has. ConfigError: a file is missing or damaged."""
    return sum(len(load_scene(root, split, name).content.episodes) for name in scenes_of(root, split))


def models_of(root: Path, split: str) -> dict[tuple[str, str], list[str]]:
    """By scene and category, the furniture models that its goals are made of. ConfigError: a file is missing or damaged."""
    records = (files.read(root / split / "scenes" / f"{name}.json", SceneRecord) for name in scenes_of(root, split))
    return {(r.scene, label): models for r in records for label, models in r.target_models.items()}
