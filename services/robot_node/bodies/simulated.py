"""A robot in a simulated building: it moves by the core's rules, and what it sees is rendered."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from surveilnav.errors import ConfigError, TargetError
from surveilnav.messages import Stair
from surveilnav.robot_body import CAMERA_HEIGHT_M, DEPTH_RANGE_M
from surveilnav.sensing.views import TrueInstances
from surveilnav.services.robot_node import core
from surveilnav.services.robot_node.bodies.body import Look
from surveilnav.services.robot_node.bodies.kept import KeptState
from surveilnav.services.robot_node.config import RobotSettings
from surveilnav.simulator.simulation import SimulatedBuilding
from surveilnav.simulator.world.goals import find_goals, judge, sample_start

#: Of a building's notes so many are told to whoever asks for the robot.
_MOST_NOTES = 8


class SimulatedBody:
    """A ``Body`` in a simulated building, beginning in ``state``. Every state is handed to ``keep`` before it is told."""

    def __init__(
        self,
        building: SimulatedBuilding,
        state: core.RobotState,
        keep: Callable[[core.RobotState], None] = lambda _: None,
    ) -> None:
        self._building, self._state, self._keep = building, state, keep
        self._labels = building.scene.truth_labels
        self.stairs: Sequence[Stair] = core.stairs_of(building.navigation)
        self.notes: Sequence[str] = [*building.notes[:_MOST_NOTES]]

    @property
    def state(self) -> core.RobotState:
        """Where it is, and what it did last."""
        return self._state

    def refusal(self, action: str, to_floor: str | None = None) -> str:
        """Why it can't carry out an action at all, for people; empty if it can."""
        return core.refusal(self._state, action, self._building.navigation, to_floor)

    def begin_mission(self, mission: str) -> None:
        """Counts path and steps from here on."""
        self._enter(core.begin_mission(self._state, mission))

    def act(self, action: str, to_floor: str | None = None) -> None:
        """Carries out one action, at once. Raises ValueError: it can't be carried out."""
        self._enter(core.act(self._state, action, self._building.navigation, to_floor))

    def halt(self) -> None:
        """Nothing to do: its actions take no time, so it never moves when this comes."""

    def _enter(self, state: core.RobotState) -> None:
        self._keep(state)
        self._state = state

    def observe(self) -> Look:
        """The rendered view of the state it is in, with its instance ids."""
        state = self._state
        T_world_camera = core.camera_pose_of(state)
        view = self._building.robot_view(T_world_camera, core.CAMERA, DEPTH_RANGE_M, state.seq)
        truth = TrueInstances(view.instance_ids, self._labels, T_world_camera)
        return Look(state, T_world_camera, core.CAMERA, CAMERA_HEIGHT_M, DEPTH_RANGE_M, view.rgb, view.depth_m, truth)


class SimulatedJudge:
    """A ``Judge`` by the benchmark's rules."""

    def __init__(self, building: SimulatedBuilding) -> None:
        self._building = building

    def __call__(self, target: str, state: core.RobotState) -> tuple[bool, float | None] | None:
        """Whether a robot that stopped in ``state`` found ``target``, and how far it is from where it would have [m]; None:
        nothing in the building is called so."""
        building = self._building
        try:
            goals = find_goals(building.scene, building.navigation, target, caster=building.caster)
        except TargetError:
            return None
        verdict = judge(goals, state, shortest_path_m=0.0)
        distance_m = verdict.distance_to_viewpoint_m
        return verdict.success, distance_m if math.isfinite(distance_m) else None


def simulated_body(building: SimulatedBuilding, settings: RobotSettings) -> SimulatedBody:
    """A body where the store says that it stood, else at its start.

    Raises:
        ConfigError: the start told isn't free floor; the message says what is.
    """
    if not settings.store:
        return SimulatedBody(building, start_state(building, settings))
    begun = repr((building.scene.content_hash, building.settings.seed, settings.start, settings.start_for))
    kept = KeptState(Path(settings.store), begun)
    state = kept.load()
    if state is None or not building.navigation.is_navigable(state.p_world, state.floor):
        state = start_state(building, settings)
    return SimulatedBody(building, state, kept.save)


def start_state(building: SimulatedBuilding, settings: RobotSettings) -> core.RobotState:
    """Where the robot begins: as told, out of sight of a target, or anywhere it can move.

    Raises:
        ConfigError: the place told isn't free floor; the message says what is.
    """
    navigation, seed = building.navigation, building.settings.seed
    if settings.start:
        return _told(building, settings.start)
    if settings.start_for:
        goals = find_goals(building.scene, navigation, settings.start_for, caster=building.caster)
        start = sample_start(building.scene, navigation, goals, seed=seed, caster=building.caster)
        return core.RobotState(*start.p_m, start.floor, start.yaw_rad)
    rng = np.random.default_rng(seed)
    floor = max(navigation.robot_area, key=lambda f: int(navigation.robot_area[f].sum()))
    return core.RobotState(*navigation.random_point(rng, floor), floor, float(rng.uniform(-np.pi, np.pi)))


def _told(building: SimulatedBuilding, start: str) -> core.RobotState:
    parts = [part.strip() for part in start.split(",")]
    floors = list(building.navigation.floors)
    try:
        x_m, y_m, floor, yaw_deg = float(parts[0]), float(parts[1]), parts[2], float(parts[3])
    except (ValueError, IndexError):
        raise ConfigError(f"a start is x,y,floor,yaw_deg such as 1.5,2.0,{floors[0]},90, got {start!r}") from None
    if floor not in floors:
        raise ConfigError(f"no floor {floor!r} in {building.scene.name}; it has {floors}")
    z_m = building.navigation.floors[floor].z_m
    if not building.navigation.is_navigable((x_m, y_m, z_m), floor):
        near = building.navigation.snap((x_m, y_m, z_m), floor)
        raise ConfigError(
            f"the robot can't stand at {x_m:g},{y_m:g} on floor {floor!r}; the nearest free place is {near}"
        )
    return core.RobotState(x_m, y_m, z_m, floor, float(np.deg2rad(yaw_deg)))
