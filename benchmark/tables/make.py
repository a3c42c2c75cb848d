"""Making a table: its runs, then its page; whatever is there already isn't played again."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import IO, NamedTuple

from surveilnav.benchmark.dataset import format as files
from surveilnav.benchmark.dataset.format import SceneRecord
from surveilnav.benchmark.dataset.load import scenes_of
from surveilnav.benchmark.runner.basis import Basis, basis_of
from surveilnav.benchmark.runner.records import Records, stored_run
from surveilnav.benchmark.runner.run import Finished, Progress, run
from surveilnav.benchmark.runner.settings import RunSettings, run_id
from surveilnav.benchmark.tables.arms import Arm, Table
from surveilnav.benchmark.tables.page import TableRow, page, plot
from surveilnav.simulator.truth.choose import choose_backend
from surveilnav.storage import atomic_write


class Made(NamedTuple):
    """A table's page, and what is missing of it: ``faults`` name scenes and episodes that aren't counted. ``complete``: of
    the arms that were wanted nothing is missing that was asked for. ``played``: how many arms nothing is missing of that was
    asked for. ``mended``: episodes that were there, but couldn't be read."""

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
    per_scene: int | None = None,
    wanted: Callable[[Arm], bool] = lambda arm: True,
    on_progress: Callable[[int, int, str], None] = lambda done, total, arm: None,
) -> Made:
    """Writes ``<out>/<table>.md`` and ``.png``, anew after every arm; runs are kept in ``<out>/records``.

    Arms that aren't ``wanted`` aren't played; the page shows what is there of them. A page without a line isn't written.
    ``per_scene``: only so many episodes of each scene are played.

    Raises:
        ConfigError: settings, dataset or records that can't be used.
    """
    split, path = table.arms[0].settings.split, out / f"{table.name}.md"
    basis, models, total = basis_of(root, split), models_of(root, split), episodes_of(root, split)
    runs = _runs(table.arms)
    playing = {name: arm for arm in table.arms if wanted(arm) for name in _runs([arm])}
    mended = _mend(playing, runs, out, basis)  # a folder that can't be used is said before hours are spent on another
    found = {
        name: Finished(there.records, there.broken, {}, total - len(there.records))
        for name, settings in runs.items()
        if (there := stored_run(_folder(out, name), settings, basis))
    }
    faults = _write(table, found, total, models, basis, path)
    for number, (name, arm) in enumerate(playing.items()):

        def report(p: Progress, before: int = number, label: str = arm.label) -> None:
            on_progress(before * p.total + p.done, len(playing) * p.total, f"{table.name}: {label}")

        found[name] = run(
            root, _folder(out, name), runs[name], workers=workers, per_scene=per_scene, on_progress=report
        )
        faults = _write(table, found, total, models, basis, path)
    complete = {name for name, finished in found.items() if finished.complete}
    played = sum(complete.issuperset(_runs([arm])) for arm in table.arms)
    return Made(path, faults, complete.issuperset(playing), played, mended)


def _mend(playing: Mapping[str, Arm], runs: Mapping[str, RunSettings], out: Path, basis: Basis) -> list[str]:
    """Opens the folders of all runs that are to be played; what couldn't be read in them is named and forgotten."""
    return [
        f"{arm.label}: {scene} episode {number}"
        for name, arm in playing.items()
        if _folder(out, name).exists()
        for scene, number in Records(_folder(out, name), runs[name], basis).forget_damaged()
    ]


def expect_own_runs(
    tables: Iterable[Table], root: Path, out: Path, wanted: Callable[[Arm], bool] = lambda arm: True
) -> None:
    """Says what of several tables can't be used before hours are spent on the first.

    Raises:
        ConfigError: a wanted arm's settings, split or folder can't be used.
        PerceptionError: a wanted arm's detectors can't be had.
    """
    basis = cache(partial(basis_of, root))  # hashes a split's files
    have_backend = cache(_have_backend)
    for name, settings in _runs(arm for table in tables for arm in table.arms if wanted(arm)).items():
        settings.check()
        own, total = basis(settings.split), episodes_of(root, settings.split)
        there = Records(_folder(out, name), settings, own).done() if _folder(out, name).exists() else ()
        if len(there) < total:
            have_backend(settings.perception, tuple(settings.detectors))


def _have_backend(name: str, detectors: tuple[str, ...]) -> None:
    """Finds the weights, or fetches them. PerceptionError: they can't be had."""
    if detectors:
        choose_backend(name, detectors=detectors, large_detectors=detectors)
    else:
        choose_backend(name)


def _runs(arms: Iterable[Arm]) -> dict[str, RunSettings]:
    """The runs of arms by their folder's name, each once."""
    return {run_id(settings): settings for arm in arms for settings in arm.runs}


def _folder(out: Path, name: str) -> Path:
    return out / "records" / name


def _write(
    table: Table,
    found: Mapping[str, Finished],
    total: int,
    models: dict[tuple[str, str], list[str]],
    basis: Basis,
    path: Path,
) -> list[str]:
    """The page and its plot, of what was found by arm; returns what isn't counted."""
    rows, faults, told = [], [], set[str]()
    for arm in table.arms:
        there = {name: found[name] for name in _runs([arm]) if name in found}
        if records := [record for finished in there.values() for record in finished.records]:
            rows.append(TableRow.from_records(arm, records))
        for finished in (finished for name, finished in there.items() if name not in told):
            faults += [f"{arm.label}: {scene} could not be played: {why}" for scene, why in finished.unopened.items()]
            faults += [
                f"{arm.label}: {b.scene} episode {b.episode_id} broke: {b.error.strip().splitlines()[-1]}"
                for b in finished.broken
            ]
        told |= there.keys()
    if rows:
        with _replacing(path.with_suffix(".png")) as file:
            plot(table, rows, file)
    if rows or faults:
        text = page(table, rows, total, models, basis)
        text += "\n## Not counted\n\n" + "\n".join(f"- {f}" for f in faults) + "\n" if faults else ""
        with _replacing(path) as file:
            file.write(text.encode())
    return faults


@contextmanager
def _replacing(path: Path) -> Iterator[IO[bytes]]:
    """A page appears whole, and others may read it."""
    with atomic_write(path) as file:
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
