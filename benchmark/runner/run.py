"""A whole run: scenes over workers, progress with time left, resumed after a kill at any moment."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from surveilnav.benchmark.canary import digest
from surveilnav.benchmark.dataset.load import load_scene, scenes_of
from surveilnav.benchmark.play.workers import in_workers
from surveilnav.benchmark.policies import policy_of
from surveilnav.benchmark.policies.language_model import Cost, kept_questions
from surveilnav.benchmark.runner.basis import Basis, basis_of
from surveilnav.benchmark.runner.play import parent_lives, play_scene
from surveilnav.benchmark.runner.records import Broken, Records
from surveilnav.benchmark.runner.row import EpisodeRecord
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.errors import ConfigError

_POLL_S = 2.0


@dataclass(frozen=True, slots=True)
class Progress:
    """Episodes."""

    done: int
    total: int


@dataclass(frozen=True, slots=True)
class Finished:
    """What a run came to. ``unopened``: scenes that couldn't be opened or kept, with why; ``missing``: how many of the
    episodes that were asked for aren't there; ``mended``: episodes that were there, but couldn't be read; ``cost``: of the
    language model, if the policy asks one."""

    records: list[EpisodeRecord]
    broken: list[Broken]
    unopened: dict[str, str]
    missing: int
    mended: tuple[tuple[str, str], ...] = ()
    cost: Cost | None = None

    @property
    def complete(self) -> bool:
        """Whether nothing is missing of what was asked for."""
        return self.missing == 0


def run(
    root: Path,
    out: Path,
    settings: RunSettings,
    *,
    workers: int,
    per_scene: int | None = None,
    on_progress: Callable[[Progress], None] = lambda _: None,
) -> Finished:
    """Plays what is missing of a split; ``per_scene``: of so many episodes of each scene (``some_of``).

    Raises:
        ConfigError: settings, dataset or records that can't be used.
    """
    settings.check()
    basis = basis_of(root, settings.split)
    wanted: dict[str, list[str]] = {}
    for scene in scenes_of(root, settings.split):
        data = load_scene(root, settings.split, scene)
        data.plan(settings.density_m2)  # a density that the dataset hasn't is said before anything is opened
        ids = [e.episode_id for e in data.content.episodes]
        wanted[scene] = ids if per_scene is None else some_of(scene, ids, per_scene)
    records = Records(out, settings, basis)
    mended = tuple(records.forget_damaged())
    asked = {(scene, e) for scene, ids in wanted.items() for e in ids}
    done = records.done()
    to_play = {s: frozenset(e for e in ids if (s, e) not in done) for s, ids in wanted.items()}
    jobs = [(root, out, basis, settings, s, ids) for s, ids in to_play.items() if ids]
    jobs.sort(key=lambda job: (-len(job[5]), job[4]))  # the largest first, so that all workers end together
    unopened: dict[str, str] = {}
    for ended in in_workers(_work, jobs, workers, _POLL_S):
        if ended is not None and ended.error:
            unopened[ended.job[4]] = ended.why
        on_progress(Progress(len(asked & records.done()), len(asked)))
    records.sort()
    played = records.all()
    missing = len(asked - {record.key for record in played})
    cost = Cost.of(kept_questions(out)) if policy_of(settings.policy).needs_language_model else None
    return Finished(played, records.broken(), dict(sorted(unopened.items())), missing, mended, cost)


def some_of(scene: str, ids: list[str], n: int) -> list[str]:
    """``n`` of a scene's episodes, or all if there are fewer; always the same, and those of 3 are among those of 6.

    Episodes are ordered by category. So they are taken evenly spaced, in each scene from another offset: no category is left out.
    """
    if n >= len(ids):
        return ids
    offset = zlib.crc32(scene.encode())
    return [ids[i] for i in sorted((offset + k * len(ids) // n) % len(ids) for k in range(n))]


def _work(job: tuple[Path, Path, Basis, RunSettings, str, frozenset[str]]) -> None:
    root, out, basis, settings, scene, ids = job
    parent = os.getppid()
    if digest() != basis.program:  # a worker reads the program anew for every scene
        raise ConfigError("what the program does was changed since this run began: begin it anew, with another --out")
    play_scene(root, out, basis, settings, scene, ids, lambda: parent_lives(parent))
