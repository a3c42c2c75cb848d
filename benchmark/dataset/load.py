"""A split of a dataset as the runner plays it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surveilnav.benchmark.dataset import format as files
from surveilnav.benchmark.dataset.axes import from_habitat, yaw_of
from surveilnav.benchmark.dataset.format import HabitatEpisode, HabitatFile, HabitatGoal, SceneCameras, SceneRecord
from surveilnav.camera_plan import CameraPlan
from surveilnav.errors import ConfigError
from surveilnav.simulator.world.goals import Goals, Start
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.scene import Instance, Scene


@dataclass(frozen=True, slots=True)
class SceneData:
    """One scene of a split: how to open it, its episodes and goals, its cameras."""

    record: SceneRecord
    content: HabitatFile
    cameras: SceneCameras

    def label_of(self, episode: HabitatEpisode) -> str:
        """The target in our spelling."""
        return files.CATEGORIES[episode.object_category]

    def check_scene(self, scene: Scene) -> None:
        """ConfigError: what was opened isn't the building that the dataset was made of."""
        if scene.content_hash != self.record.content_hash:
            raise ConfigError(
                f"{self.record.scene} came out as {scene.content_hash[:12]} here, the dataset was made of "
                f"{self.record.content_hash[:12]}: another version of the program or of the furniture; build the dataset anew"
            )

    def plan(self, density_m2: int) -> CameraPlan:
        """The cameras at a density. ConfigError: there is none of that density."""
        key = str(density_m2)
        if key not in self.cameras.cameras:
            raise ConfigError(f"the dataset has cameras per {', '.join(self.cameras.cameras)} m2, not per {key}")
        c = self.cameras
        return CameraPlan(
            self.record.building,
            self.record.content_hash,
            [f.id for f in self.record.floors],
            c.mounting_offset_m,
            c.intrinsics,
            c.cameras[key],
        )

    def goals(self, label: str, scene: Scene, navigation: NavigationMap) -> Goals:
        """The goals of a category as the file says them.

        Raises:
            ConfigError: a goal that the building doesn't have.
        """
        goals = self.content.goals_by_category[files.goals_key(self.record.scene, files.HABITAT_NAME[label])]
        by_id = {i.id: i for i in scene.instances}
        instances: list[Instance] = []
        viewpoints_of: dict[int, np.ndarray] = {}
        by_floor: dict[str, list[np.ndarray]] = {}
        for goal in goals:
            instance = by_id.get(int(goal.object_id))
            if instance is None or instance.label != label:
                raise ConfigError(
                    f"{self.record.scene} has no {label} with the number {goal.object_id}: see `dataset check`"
                )
            points = viewpoints(goal)
            instances.append(instance)
            viewpoints_of[instance.id] = points
            by_floor.setdefault(instance.floor, []).append(points)
        points_by_floor = {floor: np.unique(np.concatenate(points), axis=0) for floor, points in by_floor.items()}
        others = tuple(i for i in scene.labelled(label) if i.id not in viewpoints_of)
        return Goals(
            label,
            tuple(instances),
            others,
            points_by_floor,
            viewpoints_of,
            np.empty((0, 3), np.float32),
            navigation.distance_field(points_by_floor),
        )


def viewpoints(goal: HabitatGoal) -> np.ndarray:
    """(n, 2) float64 x, y [m, world]."""
    return np.array([from_habitat(v.agent_state.position)[:2] for v in goal.view_points], dtype=np.float64)


def start_of(episode: HabitatEpisode, scene: Scene) -> Start:
    """Where an episode begins."""
    p_m = from_habitat(episode.start_position)
    return Start(p_m, scene.floor_at(p_m[2]).id, yaw_of(episode.start_rotation), episode.info.geodesic_distance)


def scenes_of(root: Path, split: str) -> list[str]:
    """The scenes of a split by name. ConfigError: no such split."""
    manifest = files.manifest_of(root)
    if split not in manifest.splits:
        raise ConfigError(f"{root} has the splits {', '.join(manifest.splits)}, not {split!r}")
    return sorted(p.name.removesuffix(".json") for p in (root / split / "scenes").glob("*.json"))


def load_scene(root: Path, split: str, scene: str) -> SceneData:
    """ConfigError: a file is missing or damaged."""
    folder = root / split
    return SceneData(
        files.read(folder / "scenes" / f"{scene}.json", SceneRecord),
        files.read(folder / "content" / f"{scene}.json.gz", HabitatFile),
        files.read(folder / "cameras" / f"{scene}.json.gz", SceneCameras),
    )
