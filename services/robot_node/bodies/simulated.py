"""A robot in a simulated building: it moves by ``robot_motion``, and its observations are rendered."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from surveilnav.errors import TargetError
from surveilnav.messages import Stair
from surveilnav.robot_body import CAMERA, CAMERA_HEIGHT_M, DEPTH_RANGE_M
from surveilnav.robot_state import RobotState
from surveilnav.sensing.views import TrueInstances
from surveilnav.services.robot_node.bodies.body import ActionBody, Observation
from surveilnav.services.robot_node.bodies.state_file import StateFile
from surveilnav.services.robot_node.config import RobotSettings
from surveilnav.simulator.robot_start import start_state
from surveilnav.simulator.simulation import SimulatedBuilding
from surveilnav.simulator.world import robot_motion
from surveilnav.simulator.world.goals import find_goals, judge

#: So many of the newest views' instance ids are kept.
_N_TRUTHS = 4
#: A building may have hundreds of notes, and they travel in every status message.
_MAX_NOTES = 8


class SimulatedBody(ActionBody):
    """A ``Body`` that starts in ``state``. Each new state is written to ``state_file``, if there is one, before it is shown."""

    def __init__(self, building: SimulatedBuilding, state: RobotState, state_file: StateFile | None = None) -> None:
        self._building, self._state, self._file = building, state, state_file
        self._labels, self._truths = building.scene.truth_labels, dict[int, TrueInstances]()
        self.stairs: Sequence[Stair] = robot_motion.stairs_in(building.navigation)

    @property
    def notes(self) -> Sequence[str]:
        """What people should know of the building and of its file."""
        problem = self._file.problem if self._file is not None else ""
        return [*self._building.notes[:_MAX_NOTES], *([problem] if problem else [])]

    @property
    def state(self) -> RobotState:
        """Where it is, and the outcome of its last action."""
        return self._state

    def refusal(self, action: str, to_floor: str | None = None) -> str:
        """Why it can't carry out an action at all, as a sentence for people; empty if it can."""
        return robot_motion.refusal(self._state, action, self._building.navigation, to_floor)

    def begin_mission(self, mission: str) -> None:
        """Starts to count path and steps for a mission."""
        self._enter(self._state.begin_mission(mission))

    def act(self, action: str, to_floor: str | None = None) -> None:
        """Carries out one action, which takes no time. Raises ValueError if it can't be carried out."""
        self._enter(robot_motion.act(self._state, action, self._building.navigation, to_floor))

    def halt(self) -> None:
        """Does nothing: actions take no time, so the robot never moves when this is called."""

    def _enter(self, state: RobotState) -> None:
        if self._file is not None:
            self._file.save(state)
        self._state = state

    def observe(self) -> Observation:
        """The rendered view of the present state, with its instance ids."""
        state = self._state
        T_world_camera = state.camera_pose()
        view = self._building.robot_view(T_world_camera, CAMERA, DEPTH_RANGE_M, state.seq)
        truths = self._truths | {state.seq: TrueInstances(view.instance_ids, self._labels, T_world_camera)}
        self._truths = dict(sorted(truths.items())[-_N_TRUTHS:])
        return Observation(state, T_world_camera, CAMERA, CAMERA_HEIGHT_M, DEPTH_RANGE_M, view.rgb, view.depth_m)

    def truth(self, seq: int) -> TrueInstances | None:
        """Which instance each pixel of one of the newest observations shows."""
        return self._truths.get(seq)


class SimulatedJudge:
    """A ``Judge`` that applies the benchmark's success rule."""

    def __init__(self, building: SimulatedBuilding) -> None:
        self._building = building

    def __call__(self, target: str, state: RobotState) -> tuple[bool, float | None] | None:
        """See ``Judge``; None if nothing in the building is called ``target``."""
        building = self._building
        try:
            goals = find_goals(building.scene, building.navigation, target, caster=building.caster)
        except TargetError:
            return None
        verdict = judge(goals, state, shortest_path_m=0.0)
        distance_m = verdict.distance_to_viewpoint_m
        return verdict.success, distance_m if math.isfinite(distance_m) else None


def open_simulated_body(building: SimulatedBuilding, settings: RobotSettings) -> SimulatedBody:
    """The robot where it last stood according to ``settings.store``, else at its start.

    Raises:
        ConfigError: the start in the settings isn't free floor; the message says what is.
    """
    if not settings.store:
        return SimulatedBody(building, start_state(building, settings.start, settings.start_for))
    origin = repr((building.scene.content_hash, building.settings.seed, settings.start, settings.start_for))
    file = StateFile(Path(settings.store), origin)
    state = file.load()
    if state is None or not building.navigation.is_navigable(state.p_world, state.floor):
        state = start_state(building, settings.start, settings.start_for)
    return SimulatedBody(building, state, file)
