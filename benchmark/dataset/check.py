"""Is a dataset what it says it is? Every fault is named."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from benchmark.dataset import format as files
from benchmark.dataset.build import open_scene
from benchmark.dataset.integrity import damage
from benchmark.dataset.load import SceneData, load_scene, scenes_of, start_of
from benchmark.dataset.make import counts
from surveilnav.building.cameras import AZIMUTHS
from surveilnav.building.goals import MIN_DETOUR
from surveilnav.building.raycast import RayCaster
from surveilnav.errors import ConfigError, SurveilNavError

_TOLERANCE_M = 0.02
#: Of a camera: around, and straight down.
_VIEWS = AZIMUTHS + 1


@dataclass(frozen=True, slots=True)
class Fault:
    """``level``: an error makes results wrong; a note is worth knowing. ``where``: file or scene."""

    level: Literal["error", "note"]
    where: str
    what: str


def check(
    root: Path, *, deep: bool = True, on_scene: Callable[[int, int, str], None] = lambda done, total, scene: None
) -> Iterator[Fault]:
    """Faults of a dataset. ``deep``: also opens every building and compares (10 s a scene).

    Raises:
        ConfigError: there is no dataset, or one of another version.
    """
    manifest = files.manifest_of(root)
    damaged = dict(damage(root, manifest))
    yield from (Fault("error", name, what) for name, what in damaged.items())
    whole = [split for split in manifest.splits if not any(name.startswith(f"{split}/") for name in damaged)]
    for split in whole:
        if (found := counts(root, split)) != manifest.splits[split]:
            yield Fault("error", split, f"holds {found}, the manifest says {manifest.splits[split]}")
    if {"train", "val"} <= set(whole) and (disjoint := _shared(root)):
        yield disjoint
    jobs = [(split, scene) for split in manifest.splits for scene in scenes_of(root, split)]
    for done, (split, scene) in enumerate(jobs, start=1):
        yield from _scene(root, split, scene, deep)
        on_scene(done, len(jobs), scene)


def _scene(root: Path, split: str, scene: str, deep: bool) -> Iterator[Fault]:
    try:
        data = load_scene(root, split, scene)
    except ConfigError:  # which file it is was said already
        yield Fault("error", f"{split}/{scene}", "can't be looked at: a file of it is missing or damaged")
        return
    try:
        faults = [*_episodes(split, data), *_cameras(split, data)]
        yield from faults
        sound = all(f.level != "error" for f in faults)  # else what is to be compared with the building isn't there
        if deep and sound:
            yield from _building(split, data)
    except (ValueError, LookupError) as error:  # of the right format, with values that mean nothing
        yield Fault("error", f"{split}/{scene}", f"holds what can't be: {error}")


def _shared(root: Path) -> Fault | None:
    """Train and val have no plan and no model of a target in common."""
    plans: dict[str, set[str]] = {}
    models: dict[str, set[str]] = {}
    for split in ("train", "val"):
        records = [files.read(p, files.SceneRecord) for p in sorted((root / split / "scenes").glob("*.json"))]
        plans[split] = {r.building for r in records}
        models[split] = {m for r in records for used in r.target_models.values() for m in used}
    both = sorted((plans["train"] & plans["val"]) | (models["train"] & models["val"]))
    return Fault("error", "train and val", f"share {', '.join(both)}") if both else None


def _episodes(split: str, data: SceneData) -> Iterator[Fault]:
    """What the files say by themselves."""
    where = f"{split}/{data.record.scene}"
    present = {files.category_of(key) for key in data.content.goals_by_category}
    if missing := [ours for theirs, ours in files.CATEGORIES.items() if theirs not in present]:
        yield Fault("note", where, f"has no {', '.join(missing)} that a robot can get to")
    for key, goals in data.content.goals_by_category.items():
        for goal in goals:
            if not goal.view_points:
                yield Fault("error", where, f"{key}: goal {goal.object_id} has no viewpoint: unreachable")
    numbers = [e.episode_id for e in data.content.episodes]
    if numbers != [str(i) for i in range(len(numbers))]:
        yield Fault("error", where, "its episodes aren't numbered from 0 on")
    for episode in data.content.episodes:
        if files.goals_key(data.record.scene, episode.object_category) not in data.content.goals_by_category:
            yield Fault(
                "error", where, f"episode {episode.episode_id} wants a {episode.object_category} that isn't there"
            )
        if not math.isfinite(episode.info.geodesic_distance):
            yield Fault("error", where, f"episode {episode.episode_id}: no way leads to a goal")


def _cameras(split: str, data: SceneData) -> Iterator[Fault]:
    where = f"{split}/{data.record.scene}"
    densities = {m2 for f in data.record.floors for m2 in f.cameras} | set(data.cameras.cameras)
    for m2 in sorted(densities):
        cameras = data.cameras.cameras.get(m2, [])
        counted = sum(f.cameras.get(m2, 0) for f in data.record.floors)
        if counted != len(cameras):
            yield Fault("error", where, f"lists {len(cameras)} cameras per {m2} m2, its floors count {counted}")
        measured = data.cameras.view_bytes.get(m2, {})
        for camera in cameras:
            views, bytes_of = len(camera.views), len(measured.get(camera.name, []))
            if views != _VIEWS:
                yield Fault("error", where, f"camera {camera.name} per {m2} m2 has {views} views, expected {_VIEWS}")
            if bytes_of != views:
                yield Fault(
                    "error", where, f"camera {camera.name} per {m2} m2: bytes of {bytes_of} views, it has {views}"
                )


def _building(split: str, data: SceneData) -> Iterator[Fault]:
    """What the building says: does it come out the same, do goals and starts lie where they should?"""
    where = f"{split}/{data.record.scene}"
    try:
        building = open_scene(data.record, lighting="flat")
        data.check_scene(building.scene)
        scene, navigation = building.scene, building.navigation
        present = {files.CATEGORIES[files.category_of(key)] for key in data.content.goals_by_category}
        goals = {label: data.goals(label, scene, navigation) for label in sorted(present)}
        cameras = [(m2, camera) for m2 in data.cameras.cameras for camera in data.plan(int(m2)).cameras]
    except SurveilNavError as error:
        yield Fault("error", where, str(error))
        return
    for episode in data.content.episodes:
        name, start = f"episode {episode.episode_id}", start_of(episode, scene)
        way_m = goals[data.label_of(episode)].field.at(start.p_m, start.floor)
        straight_m = episode.info.euclidean_distance
        if not math.isfinite(way_m):
            yield Fault("error", where, f"{name} starts where no way leads to a goal")
        elif abs(way_m - episode.info.geodesic_distance) > _TOLERANCE_M:
            yield Fault(
                "error", where, f"{name}: the way is {way_m:.2f} m, its file says {episode.info.geodesic_distance:.2f}"
            )
        elif way_m < MIN_DETOUR * straight_m - _TOLERANCE_M:
            yield Fault(
                "error",
                where,
                f"{name}: a way of {way_m:.2f} m for {straight_m:.2f} m straight breaks the rule of starts",
            )
    for m2, camera in cameras:
        eye = np.array([camera.position_m], dtype=np.float32)
        if not _sees_something(building.caster, eye):
            yield Fault("error", where, f"camera {camera.name} per {m2} m2 sees nothing within 10 m")


def _sees_something(caster: RayCaster, eye: np.ndarray) -> bool:
    """Whether at least a tenth of the directions around a camera end within its range."""
    around = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    directions = np.stack([np.cos(around), np.sin(around), np.full(64, -0.3)], axis=-1)[None].astype(np.float32)
    t = caster.cast(np.broadcast_to(eye[:, None], directions.shape), directions).t
    return bool((t <= 10.0).mean() >= 0.1)
