"""Making a dataset: scenes, cameras and episodes, as the paper's section III says and Habitat's rules want them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from surveilnav import __version__
from surveilnav.benchmark.dataset import format as files
from surveilnav.benchmark.dataset.axes import rotation_of, to_habitat
from surveilnav.benchmark.dataset.format import (
    AgentState,
    EpisodeInfo,
    HabitatEpisode,
    HabitatFile,
    HabitatGoal,
    SceneCameras,
    SceneFloor,
    SceneRecord,
    ViewPoint,
)
from surveilnav.benchmark.dataset.splits import EDITION, SceneSpec, take
from surveilnav.benchmark.play.sight import offered_views
from surveilnav.camera_plan import CameraPlan, PlannedCamera
from surveilnav.errors import TargetError
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.simulator.world.goals import Goals, Start, find_goals, habitat_starts
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.scene import Instance, Scene

MADE_BY = f"surveilnav {__version__}"
#: Square metres of floor for one camera: the paper's two densities.
DENSITIES_M2 = (100, 200)

RULES = {
    "edition": EDITION,
    "floors": "the building's storeys",
    "cameras": "one per 100 (200) m2 of floor indoors, rounded up, 1.8 m high, bad viewpoints skipped, farthest-point sampling; "
    "none on floors that robots can't get to",
    "views": "12 at -30 degrees every 30 degrees of azimuth and one straight down, 1280x1280",
    "viewpoints": "navigable, at most 1 m from the object's box, the object in sight from 0.88 m",
    "starts": "way of 0.2 to 30 m on a floor with a goal, at least 1.05 times the straight line, any yaw",
}


def build_scene(root: Path, split: str, spec: SceneSpec, n_episodes: int) -> SceneRecord:
    """Writes a scene's three files, the record last: where it is, the others are whole."""
    building = open_scene(spec, lighting="flat")  # light is for pixels; baking that of a large building takes minutes
    scene, navigation = building.scene, building.navigation
    goals = _goals_of(building)
    starts = {label: habitat_starts(navigation, g, count=n_episodes, seed=spec.seed) for label, g in goals.items()}
    # the categories' order turns with the scene, so that what doesn't divide evenly isn't always the same category
    taken = take({k: len(v) for k, v in starts.items()}, n_episodes, first=sum(spec.scene.encode()))
    chosen = [(label, start) for label, n in taken.items() for start in starts[label][:n]]
    folder = root / split
    files.write(folder / "content" / f"{spec.scene}.json.gz", _content(spec, split, scene, navigation, goals, chosen))
    plans = {str(m2): building.plan_with(m2) for m2 in DENSITIES_M2}
    files.write(folder / "cameras" / f"{spec.scene}.json.gz", _cameras(spec, building, plans))
    record = SceneRecord(
        scene=spec.scene,
        building=spec.building,
        seed=spec.seed,
        models=spec.models,
        content_hash=scene.content_hash,
        floors=[
            SceneFloor(
                id=f.id,
                z_m=f.z_m,
                area_m2=round(f.floor_area_m2, 2),
                cameras={m2: sum(c.floor == f.id for c in plan.cameras) for m2, plan in plans.items()},
            )
            for f in navigation.floors.values()
        ],
        target_models={label: sorted({i.model for i in g.instances}) for label, g in goals.items()},
        notes=list(building.notes),
    )
    files.write(folder / "scenes" / f"{spec.scene}.json", record)
    return record


def open_scene(spec: SceneSpec | SceneRecord, lighting: str = "baked") -> SimulatedBuilding:
    """The building of a scene. AssetError, BuildingError: it can't be had."""
    return SimulatedBuilding(
        SimulationSettings(building=spec.building, seed=spec.seed, models=spec.models, lighting=lighting)
    )


def _goals_of(building: SimulatedBuilding) -> dict[str, Goals]:
    """By our label, in Habitat's order of categories; those that the building lacks are left out."""
    found = {}
    for label in files.CATEGORIES.values():
        if not building.scene.called(label):  # else ``find_goals`` looks for what it might name instead
            continue
        try:
            found[label] = find_goals(building.scene, building.navigation, label, caster=building.caster)
        except TargetError:
            continue
    return found


def _content(
    spec: SceneSpec,
    split: str,
    scene: Scene,
    navigation: NavigationMap,
    goals: dict[str, Goals],
    chosen: Sequence[tuple[str, Start]],
) -> HabitatFile:
    scene_id = f"surveilnav/{split}/{spec.scene}/{spec.scene}.glb"
    episodes = []
    for number, (label, start) in enumerate(chosen):
        nearest = min(goals[label].instances, key=lambda i: math.dist(_centre(i), start.p_m))
        straight_m = min(math.dist(start.p_m[:2], p) for p in goals[label].viewpoints[start.floor].tolist())
        episodes.append(
            HabitatEpisode(
                episode_id=str(number),
                scene_id=scene_id,
                start_position=to_habitat(start.p_m),
                start_rotation=rotation_of(start.yaw_rad),
                object_category=files.HABITAT_NAME[label],
                info=EpisodeInfo(
                    geodesic_distance=start.shortest_path_m,
                    euclidean_distance=straight_m,
                    closest_goal_object_id=str(nearest.id),
                ),
            )
        )
    by_category = {
        files.goals_key(spec.scene, files.HABITAT_NAME[label]): [_goal(i, label, g, navigation) for i in g.instances]
        for label, g in goals.items()
    }
    ids = {name: number for number, name in enumerate(files.CATEGORIES)}
    return HabitatFile(
        episodes=episodes,
        goals_by_category=by_category,
        category_to_task_category_id=ids,
        category_to_scene_annotation_category_id=ids,
    )


def _goal(instance: Instance, label: str, goals: Goals, navigation: NavigationMap) -> HabitatGoal:
    z_m = navigation.floors[instance.floor].z_m
    centre = np.array(_centre(instance)[:2])
    return HabitatGoal(
        position=to_habitat(_centre(instance)),
        object_id=str(instance.id),
        object_name=instance.name,
        object_category=files.HABITAT_NAME[label],
        room_name=instance.room or None,
        view_points=[
            ViewPoint(
                agent_state=AgentState(
                    position=to_habitat((x, y, z_m)),
                    rotation=rotation_of(math.atan2(centre[1] - y, centre[0] - x)),
                )
            )
            for x, y in goals.viewpoints_of[instance.id].tolist()
        ],
    )


def _centre(instance: Instance) -> tuple[float, float, float]:
    low, high = instance.p_min, instance.p_max
    return (low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2


def _cameras(spec: SceneSpec, building: SimulatedBuilding, plans: dict[str, CameraPlan]) -> SceneCameras:
    one = next(iter(plans.values()))
    return SceneCameras(
        scene=spec.scene,
        mounting_offset_m=one.mounting_offset_m,
        intrinsics=one.intrinsics,
        cameras={m2: plan.cameras for m2, plan in plans.items()},
        view_bytes=_view_bytes(building, plans),
    )


def _view_bytes(building: SimulatedBuilding, plans: dict[str, CameraPlan]) -> dict[str, dict[str, list[int]]]:
    """By density and camera, what its views take; a camera that hangs alike in several plans is rendered once."""
    measured: list[tuple[PlannedCamera, list[int]]] = []
    for plan in plans.values():
        known = [camera for camera, _ in measured]
        new = msgspec.structs.replace(plan, cameras=[c for c in plan.cameras if c not in known])
        offered = offered_views(building, new)
        measured += [(camera, offered[camera.name]) for camera in new.cameras]
    return {
        m2: {c.name: next(b for known, b in measured if known == c) for c in plan.cameras} for m2, plan in plans.items()
    }
