"""Plays searches and records the states of their maps, for training; what is there already is kept.

python -m training.places.record --out data/places --scenes 0:300 --searches 3         # generated buildings of no split
python -m training.places.record --out data/places --root data/objectnav --searches 8  # those of train
python -m training.places.record --out data/places_px --root data/objectnav --perception compact  # on rendered pixels
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from surveilnav.benchmark.dataset.build import open_scene
from surveilnav.benchmark.dataset.format import HabitatEpisode
from surveilnav.benchmark.dataset.load import scenes_of
from surveilnav.benchmark.dataset.splits import SceneSpec
from surveilnav.benchmark.play.episode import EpisodeResult, FusedCameras, OnStep
from surveilnav.benchmark.play.workers import in_workers
from surveilnav.benchmark.runner.play import ScenePlayer, seed_of
from surveilnav.benchmark.runner.run import some_of
from surveilnav.benchmark.runner.search import search, sight_of
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.errors import TargetError
from surveilnav.simulator.simulation import SimulatedBuilding
from surveilnav.simulator.truth.choose import choose_backend
from surveilnav.simulator.world.goals import find_goals, habitat_starts
from surveilnav.simulator.world.labels import TARGETS
from training.places.states import StateWriter, write_truth

#: Seeds of generated buildings that no split has.
FIRST_SEED = 3000


class Job(NamedTuple):
    """A building of which searches are played: ``root`` is a dataset's folder, None for a building of no split.

    ``perception``: who sees, "simulated" or the name of a detector.
    """

    out: Path
    scene: str
    n: int
    root: Path | None
    perception: str = "simulated"


class Search(NamedTuple):
    """A search that can be played: the name of its file, its target, and what plays it and returns a row about it."""

    name: str
    target: str
    play: Callable[[OnStep], dict[str, Any]]


def record(job: Job) -> str:
    """Plays the searches of a building that aren't there yet; a line for people."""
    began_s = time.monotonic()
    folder = job.out / job.scene
    if (folder / "done").is_file():
        return ""
    settings = RunSettings(split="train", perception=job.perception)
    if job.root is not None:
        player = ScenePlayer(job.root, job.scene, settings)
        building, plays = player.building, _of_dataset(job, player)
    else:
        building = open_scene(SceneSpec(job.scene.rpartition("-s")[0], 0, "train"), lighting="flat")
        plays = _of_building(job, building, settings)
    write_truth(folder / "truth.npz", building)
    n = 0
    for name, label, play in plays:
        path = folder / f"{name}.npz"
        if not path.is_file():
            writer = StateWriter(label)
            result = play(writer.on_step)
            with (folder / "rows.jsonl").open("a") as file:
                file.write(json.dumps(result) + "\n")
            writer.write(path)
        n += 1
    (folder / "done").touch()
    return f"{job.scene}: {n} searches, {time.monotonic() - began_s:.0f} s"


def _of_dataset(job: Job, player: ScenePlayer) -> Iterator[Search]:
    ids = set(some_of(job.scene, [e.episode_id for e in player.episodes], job.n))
    for episode in player.episodes:
        if episode.episode_id in ids:
            label = player.label_of(episode)
            yield Search(episode.episode_id, label, partial(_row_of_episode, player, episode))


def _of_building(job: Job, building: SimulatedBuilding, settings: RunSettings) -> Iterator[Search]:
    backend = choose_backend("simulated", seed=settings.seed)
    sight = sight_of(building, backend, settings, plan=building.plan_with(settings.density_m2))
    fused = FusedCameras(sight, settings.fusion_config())
    first = sum(job.scene.encode())
    order = [TARGETS[(first + i) % len(TARGETS)] for i in range(len(TARGETS))]
    n = 0
    for label in order:
        if n == job.n:
            return
        try:
            goals = find_goals(building.scene, building.navigation, label, caster=building.caster)
        except TargetError:
            continue
        for start in habitat_starts(building.navigation, goals, count=1, seed=first):
            n += 1
            seed = seed_of(0, job.scene, label)
            play = partial(search, sight, settings, goals, start, seed=seed, goal_on_floor=True, fused=fused)
            yield Search(label, label, partial(_row_of_search, play))


def _row_of_episode(player: ScenePlayer, episode: HabitatEpisode, on_step: OnStep) -> dict[str, Any]:
    return dict(msgspec.to_builtins(player.play(episode, on_step)))


def _row_of_search(play: Callable[..., EpisodeResult], on_step: OnStep) -> dict[str, Any]:
    verdict = play(on_step=on_step).verdict
    return {"success": verdict.success, "spl": verdict.spl}


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--root", type=Path)
    parser.add_argument(
        "--scenes", default="0:300", help="generated buildings, or scenes of the dataset: first:last[:step]"
    )
    parser.add_argument("--searches", type=int, default=3, help="of each building")
    parser.add_argument("--perception", default="simulated", help="with --root: what sees, such as compact")
    parser.add_argument("--workers", type=int, default=2)
    a = parser.parse_args(argv)
    if a.perception != "simulated" and not a.root:
        parser.error(f"--perception {a.perception} needs --root: only a dataset's buildings are lit")
    cut = slice(*(int(part) if part else None for part in a.scenes.split(":")))
    if a.root:
        names = scenes_of(a.root, "train")[cut]
    else:
        names = [f"{kind}_{FIRST_SEED + n}-s0" for n in range(500) for kind in ("office", "flats")][cut]
    jobs = [Job(a.out, name, a.searches, a.root, a.perception) for name in names]
    began_s, n = time.monotonic(), 0
    for ended in in_workers(record, jobs, a.workers, 60.0):
        if ended is None:
            continue
        n += 1
        left_s = (time.monotonic() - began_s) / n * (len(jobs) - n)
        print(f"[{n}/{len(jobs)}, {left_s / 60:.0f} min left] {ended.result or ended.why}", flush=True)


if __name__ == "__main__":
    main()
