"""The robot node: commands in, motion by the core, observations out."""

from __future__ import annotations

import threading
import time

import numpy as np

from services.robot_node import core
from services.robot_node.config import RobotSettings
from simulator.simulation import SimulatedBuilding
from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.contract import ROBOT_COMMAND, ROBOT_OBSERVATION, ROBOT_STATUS, TRUTH
from surveilnav.errors import ConfigError
from surveilnav.geometry import Pose
from surveilnav.messages import CommandReply, Observation, RobotStatus, Truth
from surveilnav.sensing.packing import encode_rgbd, pack_array

#: An observation that nobody follows up is put again, ever more seldom: the router may have lost it.
_REPEAT_S = (1.0, 2.0, 4.0, 8.0)


class RobotService:
    """Executes one command at a time and publishes what the robot sees then."""

    def __init__(
        self, node: Node, building: SimulatedBuilding, state: core.RobotState, settings: RobotSettings
    ) -> None:
        self._node, self._building, self._state, self._settings = node, building, state, settings
        self._lock = threading.Lock()
        self._mission = ""
        self._unpublished = True
        self._repeats = 0
        self._deadline_s: float | None = None
        self._published_s = 0.0
        self._latest: tuple[Observation, bytes] | None = None
        self._observation = node.publisher(ROBOT_OBSERVATION, robot=settings.id)
        self._status = node.publisher(ROBOT_STATUS, robot=settings.id)
        self._truth_labels = building.scene.truth_labels
        self._truth = node.publisher(TRUTH, source=f"robot-{settings.id}", view=0)
        self._status_s = 0.0
        self._message = ""
        self._stairs = core.stairs_of(building.navigation)
        node.serve(ROBOT_COMMAND, self._on_command, robot=settings.id)
        node.serve(ROBOT_STATUS, lambda _: Answer(self._status_message()), robot=settings.id)

    def _on_command(self, request: Request) -> Answer:
        command = request.message
        with self._lock:
            state = self._state
            if command.seq_expected != state.seq:
                return Answer(
                    CommandReply(
                        stamp_ns=clock_ns(), accepted=False, seq=state.seq,
                        error=f"expected sequence number {state.seq}, got {command.seq_expected}",
                    )
                )  # fmt: skip
            if command.mission != self._mission:
                state = core.begin_mission(state)
            if reason := core.refusal(state, command.action, self._building.navigation, command.to_floor):
                raise Refused("bad_command", reason)
            self._state = core.act(state, command.action, self._building.navigation, command.to_floor)
            self._mission = command.mission
            self._unpublished, self._repeats, self._message = True, 0, ""
            self._deadline_s = None if self._state.stopped else time.monotonic() + command.deadline_ms / 1000
            self._node.wake.set()
            return Answer(CommandReply(stamp_ns=clock_ns(), accepted=True, seq=self._state.seq))

    def step(self) -> bool:
        """One turn of the loop; True if there was something to do."""
        now_s = time.monotonic()
        with self._lock:
            state, fresh = self._state, self._unpublished
            self._unpublished = False
            if self._deadline_s is not None and now_s > self._deadline_s:
                self._deadline_s, self._message = None, "stopped: no command came before the deadline"
                self._node.log.warning("no command before the deadline: holding still", seq=state.seq)
                self._status_s = 0.0
        if now_s - self._status_s >= 1.0 or fresh:
            self._status_s = now_s
            self._status.put(self._status_message())
        if fresh:
            self._publish(state)
            self._published_s = now_s
            return True
        wait_s = _REPEAT_S[min(self._repeats, len(_REPEAT_S) - 1)]
        if self._latest and now_s - self._published_s >= wait_s and self._observation.matched:
            self._repeats += 1
            self._published_s = now_s
            self._publish_truth(state)
            self._observation.put(*self._latest)
        return False

    def _publish(self, state: core.RobotState) -> None:
        T_world_camera = core.camera_pose_of(state)
        view = self._building.robot_view(T_world_camera, core.CAMERA, core.DEPTH_RANGE_M, state.seq)
        payload, image, depth = encode_rgbd(
            view.rgb, view.depth_m, depth_range_m=core.DEPTH_RANGE_M, jpeg_quality=self._settings.jpeg_quality
        )
        observation = Observation(
            stamp_ns=clock_ns(), source=f"robot/{self._settings.id}", view=0, seq=state.seq, floor=state.floor,
            T_world_camera=Pose.from_matrix(T_world_camera), camera=core.CAMERA, mounting_offset_m=core.CAMERA_HEIGHT_M,
            depth_range_m=core.DEPTH_RANGE_M, image=image, depth=depth,
            T_world_base=Pose.from_matrix(core.base_pose_of(state)), last_action=state.last_action,  # type: ignore[arg-type]
            collided=state.collided, path_m=state.path_m,
        )  # fmt: skip
        self._latest = (observation, payload)
        self._ids = view.instance_ids
        self._publish_truth(state)
        self._observation.put(observation, payload)

    def _publish_truth(self, state: core.RobotState) -> None:
        if self._truth.matched:  # only the backends oracle and simulated ever listen
            height, width = self._ids.shape
            truth = Truth(
                stamp_ns=clock_ns(), source=f"robot/{self._settings.id}", view=0, seq=state.seq, width_px=width,
                height_px=height, labels=self._truth_labels,
                T_world_camera=Pose.from_matrix(core.camera_pose_of(state)),
            )  # fmt: skip
            self._truth.put(truth, pack_array(self._ids))

    def _status_message(self) -> RobotStatus:
        state = self._state
        kind = "stopped" if state.stopped or self._message else "moving" if self._deadline_s else "ready"
        return RobotStatus(
            stamp_ns=clock_ns(), robot=self._settings.id, floor=state.floor, seq=state.seq, pitch_rad=state.pitch_rad, state=kind,  # type: ignore[arg-type]
            T_world_base=Pose.from_matrix(core.base_pose_of(state)), message=self._message,
            stairs=self._stairs,
        )  # fmt: skip


def start_state(building: SimulatedBuilding, settings: RobotSettings) -> core.RobotState:
    """Where the robot begins: as told, out of sight of a target, or anywhere it can move.

    Raises:
        ConfigError: the place told isn't free floor; the message says what is.
    """
    navigation, seed = building.navigation, building.settings.seed
    if settings.start:
        return _told(building, settings.start)
    if settings.start_for:
        from simulator.world.goals import find_goals, sample_start

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
