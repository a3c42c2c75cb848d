"""Is a dataset what it says it is? Every fault is named."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from surveilnav.benchmark.dataset import format as files
from surveilnav.benchmark.dataset.axes import from_habitat
from surveilnav.benchmark.dataset.build import DENSITIES_M2, MADE_BY, RULES, open_scene
from surveilnav.benchmark.dataset.integrity import damage, read_manifest
from surveilnav.benchmark.dataset.load import SceneData, load_scene, scenes_of, start_of
from surveilnav.benchmark.dataset.make import counts
from surveilnav.benchmark.dataset.show import seen_floor
from surveilnav.camera_plan import AZIMUTHS, CameraPlan, PlannedCamera
from surveilnav.errors import ConfigError, SurveilNavError, TargetError
from surveilnav.simulator.simulation import SimulatedBuilding
from surveilnav.simulator.world.goals import MIN_DETOUR, Goals, find_goals

_TOLERANCE_M = 0.02
#: A camera that has less floor in sight sees nothing.
_MIN_SEEN_M2 = 1.0
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
    """Faults of a dataset. ``deep``: also opens every building and makes cameras and goals anew (2 to 20 s a scene).

    Raises:
        ConfigError: there is no dataset, or one of another version.
    """
    manifest = read_manifest(root)
    if manifest.made_by != MADE_BY:
        yield Fault("note", "dataset.json", f"was made by {manifest.made_by}, this is {MADE_BY}")
    for rule in sorted(RULES.keys() | manifest.rules.keys()):
        if (was := manifest.rules.get(rule)) != (now := RULES.get(rule)):
            yield Fault("error", "dataset.json", f"was made by another rule of {rule}: {was!r}, now it is {now!r}")
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
    except (ConfigError, UnicodeDecodeError):  # which file it is was said already
        yield Fault("error", f"{split}/{scene}", "can't be looked at: a file of it is missing or damaged")
        return
    try:
        faults = [*_names(split, scene, data), *_episodes(split, data), *_cameras(split, data)]
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


def _names(split: str, scene: str, data: SceneData) -> Iterator[Fault]:
    """Whether the files say of which scene they are: Habitat finds an episode's goals by it."""
    where = f"{split}/{scene}"
    for what, name in (("record", data.record.scene), ("cameras", data.cameras.scene)):
        if name != scene:
            yield Fault("error", where, f"its {what} are those of {name}")
    for episode in data.content.episodes:
        if Path(episode.scene_id).name != f"{scene}.glb":
            yield Fault("error", where, f"episode {episode.episode_id} is one of the scene {episode.scene_id}")


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
    """What the building says: does all come out the same, do starts lie where they should, do cameras see anything?"""
    where = f"{split}/{data.record.scene}"
    try:
        building = open_scene(data.record, lighting="flat")
        data.check_scene(building.scene)
        present = {files.CATEGORIES[files.category_of(key)] for key in data.content.goals_by_category}
        goals = {label: data.goals(label, building.scene, building.navigation) for label in sorted(present)}
        plans = {m2: data.plan(m2) for m2 in DENSITIES_M2}
    except SurveilNavError as error:
        yield Fault("error", where, str(error))
        return
    yield from _listed(where, building, data)
    for label in files.CATEGORIES.values():
        yield from _goals(where, building, label, goals.get(label))
    yield from _starts(where, building, data, goals)
    for m2, plan in plans.items():
        yield from _plan(where, building, m2, plan)


def _listed(where: str, building: SimulatedBuilding, data: SceneData) -> Iterator[Fault]:
    """What the files say of goals beside their viewpoints."""
    by_id = {str(i.id): i for i in building.scene.instances}
    for key, goals in data.content.goals_by_category.items():
        for goal in goals:
            centre = np.add(by_id[goal.object_id].p_min, by_id[goal.object_id].p_max) / 2
            if not _near(from_habitat(goal.position), centre):
                yield Fault("error", where, f"{key}: goal {goal.object_id} isn't where its file says")
        if len({goal.object_id for goal in goals}) < len(goals):
            yield Fault("error", where, f"{key}: lists a goal twice")
    for episode in data.content.episodes:
        goals = data.content.goals_by_category[files.goals_key(data.record.scene, episode.object_category)]
        if episode.info.closest_goal_object_id not in {goal.object_id for goal in goals}:
            yield Fault("error", where, f"episode {episode.episode_id}: its closest goal is none of its category")


def _goals(where: str, building: SimulatedBuilding, label: str, listed: Goals | None) -> Iterator[Fault]:
    """The goals of a category beside those that the building has by the rule of viewpoints."""
    try:
        found = find_goals(building.scene, building.navigation, label, caster=building.caster)
    except TargetError:
        if listed is not None:
            yield Fault("error", where, f"lists {label}s, and a robot can get to none")
        return
    if found.unreachable:
        numbers, of = ", ".join(str(i.id) for i in found.unreachable), len(found.unreachable) + len(found.instances)
        yield Fault(
            "note", where, f"{len(found.unreachable)} of {of} {label}s are unreachable, so they aren't goals: {numbers}"
        )
    there = listed.viewpoints_of if listed is not None else {}
    for number in sorted(found.viewpoints_of.keys() | there.keys()):
        name = f"{label} {number}"
        if number not in there:
            yield Fault("error", where, f"{name} can be reached and isn't among the goals")
        elif number not in found.viewpoints_of:
            yield Fault("error", where, f"{name} is a goal that is unreachable")
        elif not _near(there[number], found.viewpoints_of[number]):
            yield Fault("error", where, f"{name}: its viewpoints aren't those from which a robot sees it")


def _near(one: ArrayLike, other: ArrayLike) -> bool:
    return np.shape(one) == np.shape(other) and np.allclose(one, other, rtol=0.0, atol=_TOLERANCE_M)


def _starts(where: str, building: SimulatedBuilding, data: SceneData, goals: Mapping[str, Goals]) -> Iterator[Fault]:
    for episode in data.content.episodes:
        name, start = f"episode {episode.episode_id}", start_of(episode, building.scene)
        way_m = goals[data.label_of(episode)].field.at(start.p_m, start.floor)
        straight_m, said_m = episode.info.euclidean_distance, episode.info.geodesic_distance
        if not math.isfinite(way_m):
            yield Fault("error", where, f"{name} starts where no way leads to a goal")
        elif abs(way_m - said_m) > _TOLERANCE_M:
            yield Fault("error", where, f"{name}: the way is {way_m:.2f} m, its file says {said_m:.2f}")
        elif way_m < MIN_DETOUR * straight_m - _TOLERANCE_M:
            what = f"{name}: a way of {way_m:.2f} m for {straight_m:.2f} m straight breaks the rule of starts"
            yield Fault("error", where, what)


def _plan(where: str, building: SimulatedBuilding, m2: int, listed: CameraPlan) -> Iterator[Fault]:
    """The cameras of a density beside those that the rule hangs."""
    placed = building.plan_with(m2)
    if (listed.intrinsics, listed.mounting_offset_m) != (placed.intrinsics, placed.mounting_offset_m):
        yield Fault("error", where, f"cameras per {m2} m2 aren't built or mounted as the rule says")
    by_rule, there = {c.name: c for c in placed.cameras}, {c.name: c for c in listed.cameras}
    for name in sorted(by_rule.keys() | there.keys()):
        what = f"camera {name} per {m2} m2"
        if name not in there:
            yield Fault("error", where, f"{what} is missing")
        elif name not in by_rule:
            yield Fault("error", where, f"{what} is one too many")
        elif not _same_camera(there[name], by_rule[name]):
            yield Fault("error", where, f"{what} doesn't hang or look as the rule says")
        if name in there and (seen_m2 := _seen_m2(building, there[name])) < _MIN_SEEN_M2:
            yield Fault("error", where, f"{what} sees nothing: {seen_m2:.2f} m2 of its floor")


def _same_camera(one: PlannedCamera, other: PlannedCamera) -> bool:
    return (
        (one.floor, one.half) == (other.floor, other.half)
        and _near(one.position_m, other.position_m)
        and all(_near(a.matrix(), b.matrix()) for a, b in zip(one.views, other.views, strict=True))
    )


def _seen_m2(building: SimulatedBuilding, camera: PlannedCamera) -> float:
    floor = building.navigation.floors.get(camera.floor)
    if floor is None:
        return 0.0
    return float(seen_floor(building, floor, camera.position_m).sum()) * floor.grid.resolution_m**2
