"""One search, the services' cores composed in one process: no bus, no clock, the same every time.

The pictures go through the same encoders as on the bus, so the bytes are those that a camera would offer and the
detector sees what JPEG left of them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal

import numpy as np

from benchmark.oracle import OraclePlanner
from services.camera_node.core import Seen, labels_of, summary
from services.fusion.core import FusionConfig, JointMap, active_cameras
from services.planner.core import Decision, MapView, MissionState, PlannerConfig, RobotView, step
from services.planner.core.drive import FmmPlanner
from services.planner.core.state import FloorChange
from services.robot_node import core as robot
from surveilnav.building.goals import Goals, Start, Verdict, judge
from surveilnav.building.simulation import CAMERA_DEPTH_RANGE_M, PlannedCamera, SimulatedBuilding
from surveilnav.contract import CAMERA_FRAME, CAMERA_SUMMARY, ROBOT_OBSERVATION
from surveilnav.geometry import Pose
from surveilnav.messages import CameraInfo, CameraSummary, CameraViewInfo, FrameHeader, Observation, Stair
from surveilnav.perception import Backend
from surveilnav.runtime.wire import encode
from surveilnav.sensing.packing import decode_frame, encode_rgbd
from surveilnav.sensing.views import PosedView, TrueInstances, ViewPerception

_NADIR_RAD = math.radians(-75.0)
_BUILDING = "building"


@dataclass(frozen=True, slots=True)
class EncodedView:
    """A view as it arrives, what perception says of it, and the bytes that its sender offered."""

    view: PosedView
    perception: ViewPerception | None
    offered_bytes: int


@dataclass(slots=True)
class Episode:
    """What came of one search. ``reason`` names the failure, empty for a success.

    ``summary_bytes``: what each camera offered so that a floor could be chosen. ``floors``: those that the robot was
    on, in order; ``changes``: the stairs it took. ``trajectory``: (x, y, yaw) after every action, ``trajectory_floors``
    the floor of each.
    """

    verdict: Verdict
    found: bool
    steps: int
    error: str
    reason: str
    message: str
    seconds: float
    robot_bytes: int
    camera_bytes: dict[str, int]
    trajectory: list[tuple[float, float, float]] = field(default_factory=list)
    summary_bytes: dict[str, int] = field(default_factory=dict)
    floors: tuple[str, ...] = ()
    changes: tuple[FloorChange, ...] = ()
    trajectory_floors: list[str] = field(default_factory=list)


class CameraViews:
    """The views of a building's cameras, each encoded and perceived once: they don't change."""

    def __init__(self, building: SimulatedBuilding, backend: Backend) -> None:
        self._building, self._backend = building, backend
        self.infos = [_info(building, camera) for camera in building.plan.cameras]
        self._cameras = {camera.name: camera for camera in building.plan.cameras}
        self.of = lru_cache(maxsize=None)(self._of)
        self.summary = lru_cache(maxsize=None)(self._summary)

    def _of(self, name: str) -> tuple[EncodedView, ...]:
        camera = self._cameras[name]
        return tuple(self._view(camera, index) for index in range(len(camera.views)))

    def _summary(self, name: str) -> tuple[CameraSummary, int]:
        """What a camera reports of all its views, made by its own perception, and the bytes that it offers for it."""
        seen = {}
        for index, view in enumerate(self.of(name)):
            labels: dict[str, float] = {}
            for detected in view.perception.detections if view.perception else ():
                labels[detected.label] = max(detected.score, labels.get(detected.label, 0.0))
            seen[index] = Seen(1, labels)
        floor = self._cameras[name].floor
        message = summary(name, floor, labels_of(seen), stamp_ns=0)
        key = CAMERA_SUMMARY.key_for(building=_BUILDING, floor=floor, camera=name)
        return message, len(encode(message)) + len(key)

    def by_floor(self) -> dict[str, dict[str, float]]:
        """Floor -> label -> highest confidence that a camera of that floor reports."""
        floors: dict[str, dict[str, float]] = {}
        for info in self.infos:
            labels = floors.setdefault(info.floor, {})
            for label, confidence in self.summary(info.camera)[0].labels.items():
                labels[label] = max(confidence, labels.get(label, 0.0))
        return floors

    def _view(self, camera: PlannedCamera, index: int) -> EncodedView:
        rendered = self._building.camera_view(camera, index)
        payload, image, depth = encode_rgbd(
            rendered.rgb, rendered.depth_m, depth_range_m=CAMERA_DEPTH_RANGE_M, jpeg_quality=85
        )
        plan = self._building.plan
        header = FrameHeader(
            stamp_ns=0, source=f"camera/{camera.name}", view=index, seq=1, floor=camera.floor,
            T_world_camera=camera.views[index], camera=plan.intrinsics, mounting_offset_m=plan.mounting_offset_m,
            depth_range_m=CAMERA_DEPTH_RANGE_M, image=image, depth=depth,
        )  # fmt: skip
        view = decode_frame(header, payload)
        key = CAMERA_FRAME.key_for(building=_BUILDING, floor=camera.floor, camera=camera.name, view=index)
        truth = TrueInstances(rendered.instance_ids, _labels(self._building, self._backend))
        return EncodedView(view, perceive(self._backend, view, truth), len(payload) + len(encode(header)) + len(key))


def _labels(building: SimulatedBuilding, backend: Backend) -> dict[int, str]:
    return building.scene.labels_by_id if backend.needs_truth else {}


def perceive(backend: Backend, view: PosedView, truth: TrueInstances) -> ViewPerception | None:
    """What perception says of a view; None for one that looks straight down, which detectors can't read."""
    forward = view.T_world_camera[:3, 2]
    if math.asin(float(np.clip(forward[2], -1, 1))) < _NADIR_RAD:
        return None
    return backend.perceive(
        view.rgb, view.depth_m, view.camera, truth=truth if backend.needs_truth else None, key=(view.source, view.view, view.seq)
    )  # fmt: skip


def _info(building: SimulatedBuilding, camera: PlannedCamera) -> CameraInfo:
    return CameraInfo(
        stamp_ns=0, camera=camera.name, floor=camera.floor, position_m=camera.position_m,
        mounting_offset_m=building.plan.mounting_offset_m, intrinsics=building.plan.intrinsics,
        views=[CameraViewInfo(i, pose) for i, pose in enumerate(camera.views)],
    )  # fmt: skip


def run_episode(
    building: SimulatedBuilding,
    backend: Backend,
    cameras: CameraViews | None,
    goals: Goals,
    start: Start,
    *,
    max_steps: int = 500,
    fusion: FusionConfig | None = None,
    settings: PlannerConfig | None = None,
    planner: Literal["fmm", "sp"] = "fmm",
    summaries: bool = True,
    on_step: Callable[[int, PosedView, JointMap, MapView, Decision], None] | None = None,
) -> Episode:
    """Searches for ``goals.label`` from ``start``; ``cameras`` None means without surveillance.

    ``planner``: ``fmm`` drives by the known map, ``sp`` is the oracle that knows the true navigation mesh.
    ``summaries``: whether the cameras of all floors report what they last saw.
    ``on_step(step, view, joint, maps, decision)`` may look on.
    """
    began_s = time.perf_counter()
    joint = JointMap(fusion)
    state = robot.RobotState(*start.p_m, start.floor, start.yaw_rad)
    mission, config = MissionState(goals.label, max_steps=max_steps), settings or PlannerConfig()
    driver = OraclePlanner(building.navigation) if planner == "sp" else FmmPlanner()
    stairs = tuple(robot.stairs_of(building.navigation))
    reported = cameras.by_floor() if cameras is not None and summaries and len(building.navigation.floors) > 1 else {}
    text = backend.embed_texts([f"seems like there is a {goals.label}"])[0]
    invoked: dict[str, int] = {}
    robot_bytes = 0
    trajectory, floors = [(state.x_m, state.y_m, state.yaw_rad)], [state.floor]
    while True:
        # active camera invocation (eq. 1)
        robot_view = observe(building, backend, state)
        if cameras is not None:
            for name in active_cameras([robot_view.view.floor_z_m], cameras.infos):
                if name not in invoked:
                    views = cameras.of(name)
                    invoked[name] = sum(v.offered_bytes for v in views)
                    for camera_view in views:
                        joint.integrate(camera_view.view, camera_view.perception)
        # joint maps
        placed = joint.integrate(robot_view.view, robot_view.perception)
        robot_bytes += robot_view.offered_bytes
        # waypoint and action
        maps = map_view(joint, placed.floor, text)
        mission, decision = step(mission, maps, robot_state_view(state, stairs), config, driver, reported)
        if on_step is not None:
            on_step(state.seq, robot_view.view, joint, maps, decision)
        # a refused stair leaves the robot where it is: the mission sees that at its next step
        if decision.action and not robot.refusal(state, decision.action, building.navigation, decision.to_floor):
            state = robot.act(state, decision.action, building.navigation, decision.to_floor)
            trajectory.append((state.x_m, state.y_m, state.yaw_rad))
            floors.append(state.floor)
        if decision.finished or decision.action is None:
            break
    verdict = judge(goals, state, shortest_path_m=start.shortest_path_m)
    return Episode(
        verdict, decision.found, mission.step, decision.error, reason_of(verdict, decision), decision.message,
        time.perf_counter() - began_s, robot_bytes, invoked, trajectory,
        {info.camera: cameras.summary(info.camera)[1] for info in cameras.infos} if cameras and reported else {},
        (start.floor, *(change.to_floor for change in mission.changes)), tuple(mission.changes), floors,
    )  # fmt: skip


def observe(building: SimulatedBuilding, backend: Backend, state: robot.RobotState) -> EncodedView:
    """What the robot sees at ``state``, through the encoders and perception."""
    T_world_camera = robot.camera_pose_of(state)
    rendered = building.robot_view(T_world_camera, robot.CAMERA, robot.DEPTH_RANGE_M, state.seq)
    payload, image, depth = encode_rgbd(rendered.rgb, rendered.depth_m, depth_range_m=robot.DEPTH_RANGE_M)
    header = Observation(
        stamp_ns=state.seq, source="robot/r1", view=0, seq=state.seq, floor=state.floor,
        T_world_camera=Pose.from_matrix(T_world_camera), camera=robot.CAMERA, mounting_offset_m=robot.CAMERA_HEIGHT_M,
        depth_range_m=robot.DEPTH_RANGE_M, image=image, depth=depth,
        T_world_base=Pose.from_matrix(robot.base_pose_of(state)), last_action=state.last_action,  # type: ignore[arg-type]
        collided=state.collided, path_m=state.path_m,
    )  # fmt: skip
    key = ROBOT_OBSERVATION.key_for(building=_BUILDING, robot="r1")
    view = decode_frame(header, payload)
    truth = TrueInstances(rendered.instance_ids, _labels(building, backend))
    return EncodedView(view, perceive(backend, view, truth), len(payload) + len(encode(header)) + len(key))


def map_view(joint: JointMap, floor: str, text: np.ndarray) -> MapView:
    """The planner's view of the joint maps of a floor."""
    grid, occupancy = joint.layer(floor, "occupancy")
    layers = {name: joint.layer(floor, name)[1] for name in ("explored", "frontier")}
    value = joint.layer(floor, "value", text)[1]
    return MapView(
        floor, joint.floors[floor], grid, occupancy, layers["explored"], layers["frontier"], value,  # type: ignore[arg-type]
        joint.objects(floor), joint.floor_revision(floor),
    )  # fmt: skip


def robot_state_view(state: robot.RobotState, stairs: tuple[Stair, ...] = ()) -> RobotView:
    return RobotView(
        state.seq, state.x_m, state.y_m, state.yaw_rad, state.pitch_rad, state.floor, state.collided, state.last_action,
        state.path_m, stairs,
    )  # fmt: skip


def reason_of(verdict: Verdict, decision: Decision) -> str:
    """The failure's name: where in the pipeline it went wrong."""
    if verdict.success:
        return ""
    if not decision.found:
        return decision.error or "gave_up"
    return "stopped_short" if verdict.success_at_1_m else "false_positive"
