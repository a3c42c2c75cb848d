"""What a robot took for the target: searches of a run that stopped at something else, played once more.

    python -m surveilnav.benchmark.studies.taken RUN --root DATASET > TAKEN.json

A search is the same whenever it is played. So its last decision says which object of the map it stopped at, and the
simulator which thing most of that object's points lie on.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from surveilnav.benchmark.runner.play import ScenePlayer
from surveilnav.benchmark.runner.records import read, read_facts
from surveilnav.benchmark.runner.row import EpisodeRecord
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.errors import ConfigError, SurveilNavError
from surveilnav.messages import ObjectRecord
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core import JointMap
from surveilnav.services.planner.core import Decision, MapView
from surveilnav.simulator.furniture.labels import PARTS, word_for
from surveilnav.simulator.world.raycast import NOTHING, RayCaster
from surveilnav.simulator.world.scene import Scene

#: By (scene, episode): a thing's class and name.
Taken = Mapping[tuple[str, str], str]
#: Three float32.
_POINT_BYTES = 12


@dataclass
class _Last:
    """The object that a search's last decision was about."""

    taken: ObjectRecord | None = None

    def on_step(self, step: int, view: PosedView, joint: JointMap, maps: MapView, decision: Decision) -> None:
        self.taken = next((o for o in maps.objects if o.id == decision.object_id), None)


def taken_in(run: Path, root: Path) -> Iterable[dict[str, Any]]:
    """Of each search that stopped at something else: scene, episode, and ``taken`` (empty: it can't be said).

    Raises:
        ConfigError: no run, no such dataset, or a search that comes out otherwise now.
    """
    wrong = [r for r in read(run) if r.reason == "false_positive"]
    settings = msgspec.convert((read_facts(run) or {}).get("settings"), RunSettings)
    for scene, records in groupby(wrong, key=lambda r: r.scene):
        player = ScenePlayer(root, scene, settings)
        caster = RayCaster(player.scene)
        for record in records:
            last = _Last()
            episode = next(e for e in player.episodes if e.episode_id == record.episode_id)
            check_same(record, player.play(episode, last.on_step))
            taken = "" if last.taken is None else thing_named(player.scene, caster, last.taken)
            yield {"scene": scene, "episode_id": record.episode_id, "taken": taken}


def read_taken(path: Path) -> Taken:
    """What the command said. ConfigError: that isn't it."""
    try:
        return {(t["scene"], t["episode_id"]): t["taken"] for t in json.loads(path.read_text("utf-8"))["taken"]}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(
            f"{path} isn't what `python -m surveilnav.benchmark.studies.taken` prints: {error!r}"
        ) from error


def check_same(was: EpisodeRecord, now: EpisodeRecord) -> None:
    """ConfigError: a search came out otherwise than when the run was played."""
    if (was.steps, was.reason, round(was.path_m, 3)) != (now.steps, now.reason, round(now.path_m, 3)):
        raise ConfigError(
            f"{was.scene} search {was.episode_id} took {was.steps} steps ({was.reason}), now {now.steps} ({now.reason}): "
            "play the run anew with this program"
        )


def thing_named(scene: Scene, caster: RayCaster, taken: ObjectRecord) -> str:
    """What most of an object's points lie on: its class, and its name in the plan if that says more."""
    whole = len(taken.points) // _POINT_BYTES * _POINT_BYTES
    points = np.frombuffer(taken.points[:whole], np.float32).reshape(-1, 3)
    at = points if len(points) else np.array([taken.center_m], np.float32)
    triangles = caster.nearest(at)
    owners = Counter(scene.instance_of_triangle[triangles[triangles != NOTHING]].tolist())
    thing = next((i for i in scene.instances if owners and i.id == owners.most_common(1)[0][0]), None)
    if thing is None:
        return ""
    word = word_for(thing.name, thing.label)
    if thing.label in PARTS or word == thing.name.lower():
        return word
    return f"{word} ({thing.name})" if word else thing.name


def main(argv: Sequence[str] | None = None) -> int:
    """Prints one object: {"taken": [...]}."""
    parser = argparse.ArgumentParser(
        prog="python -m surveilnav.benchmark.studies.taken", description=__doc__.splitlines()[0]
    )
    parser.add_argument("run", type=Path, help="a run's folder")
    parser.add_argument("--root", type=Path, required=True, help="the dataset's folder")
    options = parser.parse_args(argv)
    print(json.dumps({"taken": list(taken_in(options.run, options.root))}))
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except SurveilNavError as error:
        sys.exit(f"error: {error}")
