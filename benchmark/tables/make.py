"""Making a table: its runs, then its page; whatever is there already isn't played again."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import IO, NamedTuple

from benchmark.dataset import format as files
from benchmark.dataset.format import SceneRecord
from benchmark.dataset.load import scenes_of
from benchmark.runner.basis import basis_of
from benchmark.runner.records import Records, kept
from benchmark.runner.run import Finished, Progress, run
from benchmark.tables.arms import Arm, Table
from benchmark.tables.page import Line, page, plot
from surveilnav.building.stored import replacing


class Made(NamedTuple):
    """A table's page, and what is missing of it: ``faults`` name scenes and episodes that aren't counted. ``complete``: of
    the arms that were wanted nothing is missing. ``played``: how many arms nothing is missing of. ``mended``: episodes that
    were there, but couldn't be read."""

    page: Path
    faults: list[str]
    complete: bool
    played: int
    mended: list[str]


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

    Arms that aren't ``wanted`` aren't played; the page shows what is there of them. A page without a line isn't written.

    Raises:
        ConfigError: settings, dataset or records that can't be used.
    """
    split, path = table.arms[0].settings.split, out / f"{table.name}.md"
    models, total, basis = models_of(root, split), episodes_of(root, split), basis_of(root, split)
    folders = {arm.slug: _folder(out, arm) for arm in table.arms}
    playing = [arm for arm in table.arms if wanted(arm)]
    mended = [  # opens them all: a folder that can't be used is said before hours are spent on another
        f"{arm.label}: {scene} episode {number}"
        for arm in playing
        if folders[arm.slug].exists()
        for scene, number in Records(folders[arm.slug], arm.settings, basis).mend()
    ]
    found: dict[str, Finished] = {}
    for arm in table.arms:
        if there := kept(folders[arm.slug], arm.settings, basis):
            found[arm.slug] = Finished(there.records, there.broken, {}, total)
    faults = _write(table, found, total, models, path)
    for number, arm in enumerate(playing):

        def report(p: Progress, before: int = number, label: str = arm.label) -> None:
            on_progress(before * p.total + p.done, len(playing) * p.total, f"{table.name}: {label}")

        found[arm.slug] = run(root, folders[arm.slug], arm.settings, workers=workers, on_progress=report)
        faults = _write(table, found, total, models, path)
    played = sum(finished.complete for finished in found.values())
    return Made(path, faults, all(found[arm.slug].complete for arm in playing), played, mended)


def expect_own_runs(
    tables: Iterable[Table], root: Path, out: Path, wanted: Callable[[Arm], bool] = lambda arm: True
) -> None:
    """Says what of several tables can't be used before hours are spent on the first.

    Raises:
        ConfigError: a wanted arm's settings or folder can't be used.
    """
    basis = cache(partial(basis_of, root))  # hashes a split's files
    for arm in (arm for table in tables for arm in table.arms if wanted(arm)):
        arm.settings.check()
        if _folder(out, arm).exists():
            Records(_folder(out, arm), arm.settings, basis(arm.settings.split))


def _folder(out: Path, arm: Arm) -> Path:
    return out / "runs" / arm.slug


def _write(
    table: Table, found: Mapping[str, Finished], total: int, models: dict[tuple[str, str], list[str]], path: Path
) -> list[str]:
    """The page and its plot, of what was found by arm; returns what isn't counted."""
    there = [(arm, found[arm.slug]) for arm in table.arms if arm.slug in found]
    lines = [Line.of(arm, finished.records) for arm, finished in there if finished.records]
    faults = []
    for arm, finished in there:
        faults += [f"{arm.label}: {scene} could not be played: {why}" for scene, why in finished.unopened.items()]
        faults += [
            f"{arm.label}: {b.scene} episode {b.episode_id} broke: {b.error.strip().splitlines()[-1]}"
            for b in finished.broken
        ]
    if lines:
        with _replacing(path.with_suffix(".png")) as file:
            plot(table, lines, file)
    if lines or faults:
        text = page(table, lines, total, models)
        text += "\n## Not counted\n\n" + "\n".join(f"- {f}" for f in faults) + "\n" if faults else ""
        with _replacing(path) as file:
            file.write(text.encode())
    return faults


@contextmanager
def _replacing(path: Path) -> Iterator[IO[bytes]]:
    """A page appears whole, and others may read it."""
    with replacing(path) as file:
        os.fchmod(file.fileno(), 0o644)
        yield file


def episodes_of(root: Path, split: str) -> int:
    """How many a split has, by the manifest. ConfigError: there is no such dataset or split."""
    scenes_of(root, split)  # refuses a split that the dataset hasn't
    return files.manifest_of(root).splits[split].episodes


def models_of(root: Path, split: str) -> dict[tuple[str, str], list[str]]:
    """By scene and category, the furniture models that its goals are made of. ConfigError: a file is missing or damaged."""
    records = (files.read(root / split / "scenes" / f"{name}.json", SceneRecord) for name in scenes_of(root, split))
    return {(r.scene, label): models for r in records for label, models in r.target_models.items()}
