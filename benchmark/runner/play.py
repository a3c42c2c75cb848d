"""Playing the episodes of one scene: the building is opened once, its static cameras are fused once."""

from __future__ import annotations

import hashlib
import os
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from surveilnav.benchmark.dataset.build import open_scene
from surveilnav.benchmark.dataset.format import HabitatEpisode
from surveilnav.benchmark.dataset.load import SceneData, load_scene, start_of
from surveilnav.benchmark.play.episode import EpisodeResult, FusedCameras, OnStep
from surveilnav.benchmark.policies import LanguageModel, policy_of
from surveilnav.benchmark.policies.language_model import LanguageModelSettings
from surveilnav.benchmark.runner.basis import Basis
from surveilnav.benchmark.runner.records import Broken, Records
from surveilnav.benchmark.runner.row import EpisodeRecord
from surveilnav.benchmark.runner.search import search, sight_of
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.errors import SurveilNavError
from surveilnav.simulator.simulation import SimulatedBuilding
from surveilnav.simulator.truth.choose import choose_backend
from surveilnav.simulator.world.goals import Goals
from surveilnav.simulator.world.scene import Scene


class ScenePlayer:
    """One scene of a run, open."""

    def __init__(
        self, root: Path, scene: str, settings: RunSettings, language_model: LanguageModel | None = None
    ) -> None:
        """ConfigError and what opening a building may raise. ``language_model``: for a policy that needs one."""
        self._settings, self._language_model = settings, language_model
        self._data: SceneData = load_scene(root, settings.split, scene)
        networks: dict[str, Any] = {}
        if settings.detectors:
            networks = {"detectors": settings.detectors, "large_detectors": settings.detectors}
        backend = choose_backend(settings.perception, seed=settings.seed, harder=settings.harder, **networks)
        self._building: SimulatedBuilding = open_scene(
            self._data.record, lighting="flat" if backend.needs_truth else "baked"
        )
        self._data.check_scene(self._building.scene)
        self._sight = sight_of(
            self._building,
            backend,
            settings,
            plan=self._data.plan(settings.density_m2),
            view_bytes=self._data.cameras.view_bytes[str(settings.density_m2)],
        )
        self._fused = FusedCameras(self._sight, settings.fusion_config())
        self._goals: dict[str, Goals] = {}

    @property
    def episodes(self) -> list[HabitatEpisode]:
        return self._data.content.episodes

    @property
    def building(self) -> SimulatedBuilding:
        """The simulated building, open."""
        return self._building

    def label_of(self, episode: HabitatEpisode) -> str:
        """What an episode searches, as we call it."""
        return self._data.label_of(episode)

    @property
    def scene(self) -> Scene:
        """The building as it is: for whoever judges."""
        return self._building.scene

    def play(self, episode: HabitatEpisode, on_step: OnStep | None = None) -> EpisodeRecord:
        """One search, the same whenever and wherever it is played; ``on_step`` may look on."""
        s, building = self._settings, self._building
        label, seed = self._data.label_of(episode), seed_of(s.seed, self._data.record.scene, episode.episode_id)
        if label not in self._goals:
            self._goals[label] = self._data.goals(label, building.scene, building.navigation)
        goals, start = self._goals[label], start_of(episode, building.scene)
        outcome = search(
            self._sight,
            s,
            goals,
            start,
            seed=seed,
            goal_on_floor=True,  # Habitat's rule, and the dataset's
            fused=self._fused,
            on_step=on_step,
            language_model=self._language_model,
        )
        floor_z_m = building.navigation.floors[start.floor].z_m
        known = self._fused.chance_at_goal(goals, floor_z_m) if s.surveillance else None
        return self._record(episode, outcome, known)

    def _record(self, episode: HabitatEpisode, outcome: EpisodeResult, camera_chance: float | None) -> EpisodeRecord:
        verdict = outcome.verdict
        tiers = {"jpeg+depth": sum(outcome.camera_bytes.values()), "summaries": sum(outcome.summary_bytes.values())}
        return EpisodeRecord(
            scene=self._data.record.scene,
            episode_id=episode.episode_id,
            category=self._data.label_of(episode),
            success=verdict.success,
            spl=verdict.spl,
            soft_spl=verdict.soft_spl,
            steps=outcome.steps,
            path_m=verdict.path_m,
            shortest_path_m=verdict.shortest_path_m,
            distance_m=verdict.distance_to_viewpoint_m if verdict.distance_to_viewpoint_m < 1e6 else None,
            reason=outcome.reason,
            seen=outcome.seen,
            bytes=tiers if self._settings.surveillance else {},
            seconds=outcome.seconds,
            approach=outcome.approach,
            camera_chance=camera_chance,
        )


def seed_of(run_seed: int, scene: str, episode_id: str) -> int:
    """An episode's own seed, at least 1."""
    digest = hashlib.sha256(repr((run_seed, scene, episode_id)).encode()).digest()
    return int.from_bytes(digest[:6], "little") + 1


def play_scene(
    root: Path,
    out: Path,
    basis: Basis,
    settings: RunSettings,
    scene: str,
    wanted: frozenset[str],
    alive: Callable[[], bool] = lambda: True,
) -> None:
    """Plays episodes of a scene and keeps each; one that fails by a bug of ours is kept as broken.

    Raises:
        SurveilNavError: the scene can't be opened, or records can't be kept.
    """
    records = Records(out, settings, basis)
    asks = policy_of(settings.policy).needs_language_model
    model = LanguageModel(settings.language_model, LanguageModelSettings.of_environment(), out) if asks else None
    player = ScenePlayer(root, scene, settings, model)
    for episode in player.episodes:
        if episode.episode_id not in wanted:
            continue
        if not alive():
            return
        try:
            record = player.play(episode)
        except SurveilNavError:
            raise
        except Exception:  # one episode's bug must not end the others'
            broken = Broken(scene=scene, episode_id=episode.episode_id, error=traceback.format_exc())
            records.add_broken(broken)
            continue
        records.add(record)


def parent_lives(parent: int) -> bool:
    """Whether whoever started this worker still lives; it must not go on unseen."""
    return os.getppid() == parent
