"""How well detections become objects: every way to associate them, on the same recorded views.

    python -m surveilnav.benchmark.studies.association --out docs/results/association

Records six homes once (a robot's tour and all camera views, a real detector asked once), then replays the same
detections through the object map in many configurations. Both are resumable and kept in ``--recordings``: a recording
is a file, a replay a line of ``replays.jsonl``; lines of other configurations, recordings or
programs (``surveilnav.benchmark.canary.digest``) are done again.
``--table`` writes the page from what there is.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from surveilnav.benchmark.canary import digest
from surveilnav.benchmark.play.workers import in_workers
from surveilnav.benchmark.studies.association.page import Results, page, plot
from surveilnav.benchmark.studies.association.replays import SEED, Player, good_detections, score, variants
from surveilnav.benchmark.studies.recordings import TOURS, Recording, load, record, save
from surveilnav.benchmark.studies.rows import Rows
from surveilnav.errors import SurveilNavError
from surveilnav.services.fusion.core import ObjectConfig
from surveilnav.simulator.sources import TRAIN_HOMES


@dataclass(frozen=True, slots=True)
class Job:
    """All replays of one tour of a home."""

    home: str
    tour: str
    perception: str
    folder: Path

    @property
    def path(self) -> Path:
        """Where its recording is kept."""
        return self.folder / f"{self.home}-s{SEED}-{self.tour}-{self.perception}.recording"


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def recording_of(job: Job) -> Recording:
    """The kept recording of a home, made first if there is none."""
    from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
    from surveilnav.simulator.truth.choose import choose_backend

    kept = load(job.path)
    if kept is not None:
        return kept
    building = SimulatedBuilding(SimulationSettings(building=job.home, seed=SEED))
    _say(f"{job.home}: preparing")
    building.prepare()
    began_s = time.monotonic()

    def tell(done: int, of: int) -> None:
        if done % 50 == 0:
            left_s = (time.monotonic() - began_s) / done * (of - done)
            _say(f"{job.home}: {done}/{of} views, about {left_s / 60:.1f} min left")

    made = record(building, choose_backend(job.perception), TOURS[job.tour], tell)
    save(made, job.path)
    return load(job.path) or made  # as kept, so that the first replay is like all others


def rows_in(folder: Path) -> Rows:
    """The replays that are kept in a folder."""
    return Rows(folder / "replays.jsonl", ("group", "name", "fingerprint"))


def replay_all(job: Job) -> int:
    """Plays what is missing of a home; returns how many replays it made."""
    stamp = {"home": job.home, "tour": job.tour, "perception": job.perception, "program": digest()}
    rows = rows_in(job.folder)
    done = rows.done(**stamp)
    missing = [v for v in variants(job.tour) if (v.group, v.name, v.fingerprint) not in done]
    if not missing:
        return 0
    recording = recording_of(job)
    player, good = Player(recording), good_detections(recording)
    player.play(ObjectConfig())  # compiles, and warms the caches, outside of what is timed
    began_s = time.monotonic()
    for i, variant in enumerate(missing):
        result = player.play(variant.config)
        facts = stamp | {"group": variant.group, "name": variant.name, "fingerprint": variant.fingerprint}
        cost = {
            "cpu_ms": [round(float(f(result.cpu_ms)), 3) for f in (np.median, np.mean, _p99)],
            "first_last_ms": [round(float(np.median(part)), 3) for part in _ends(result.cpu_ms)],
            "locate_ms": round(player.locate_ms, 3),
            "objects": len(result.objects),
            "shape_bytes": result.shape_bytes,
            "views": len(result.cpu_ms),
        }
        rows.append(facts | cost | score(recording.things, good, result.objects))
        if i % 20 == 19:
            left_s = (time.monotonic() - began_s) / (i + 1) * (len(missing) - i - 1)
            _say(f"{job.home}: {i + 1}/{len(missing)} replays, about {left_s / 60:.1f} min left")
    return len(missing)


def _p99(values: Sequence[float]) -> float:
    return float(np.percentile(values, 99))


def _ends(values: Sequence[float]) -> tuple[Sequence[float], Sequence[float]]:
    k = max(1, min(100, len(values) // 3))
    return values[:k], values[-k:]


def main(argv: Sequence[str] | None = None) -> int:
    """Plays what is missing and writes page and plot; 1 if a home couldn't be played."""
    options = _parser().parse_args(argv)
    for folder in (options.out, options.recordings):
        folder.mkdir(parents=True, exist_ok=True)
    failed = []
    if not options.table:
        jobs = [Job(home, t, options.perception, options.recordings) for t in options.tours for home in options.homes]
        for ended in in_workers(replay_all, jobs, options.workers):
            if ended is not None and ended.error:
                failed.append(f"{ended.job.home}: {ended.error}")
    for error in failed:
        _say(error)
    records = [
        r
        for r in rows_in(options.recordings).load()
        if r["perception"] == options.perception and r["home"] in options.homes and r["tour"] in options.tours
    ]
    results = {tour: Results(tour, records) for tour in options.tours}
    (options.out / "README.md").write_text(page(results, _command(options)))
    plot(results[options.tours[0]], options.out / "association.png")
    return 1 if failed else 0


_DEFAULTS: dict[str, Any] = {"perception": "onnx-coco", "tours": list(TOURS), "homes": list(TRAIN_HOMES)}


def _command(options: argparse.Namespace) -> str:
    """What makes this page."""
    given = [(name, getattr(options, name), default) for name, default in _DEFAULTS.items()]
    more = [f"--{n} {' '.join(v) if isinstance(v, list) else v}" for n, v, default in given if v != default]
    return " ".join(["python -m surveilnav.benchmark.studies.association", *more])


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m surveilnav.benchmark.studies.association", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--out", type=Path, default=Path("docs/results/association"), help="where the page goes")
    parser.add_argument("--recordings", type=Path, default=Path("runs/association"), help="views and replays, kept")
    parser.add_argument("--homes", nargs="*", default=_DEFAULTS["homes"])
    parser.add_argument(
        "--perception", default=_DEFAULTS["perception"], choices=["compact", "onnx-coco", "oracle", "simulated"]
    )
    parser.add_argument("--tours", nargs="*", default=_DEFAULTS["tours"], choices=list(TOURS))
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--table", action="store_true", help="only write the page of what there is")
    return parser


if __name__ == "__main__":
    try:
        sys.exit(main())
    except SurveilNavError as error:
        sys.exit(f"error: {error}")
