"""One search, the services' cores composed in one process: no bus, no clock, the same every time."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import groupby

import numpy as np

from benchmark.play.sight import Sight
from benchmark.policies.policy import Searcher
from services.fusion.core import FusionConfig, JointMap, active_cameras
from services.planner.core import Decision, MapView, RobotView
from services.robot_node import core as robot
from simulator.world.goals import Goals, Start, Verdict, judge
from surveilnav.messages import Stair
from surveilnav.sensing.views import PosedView

_NO_SUMMARIES: Mapping[str, Mapping[str, float]] = {}


@dataclass(slots=True)
class Episode:
    """What came of one search. ``reason`` names the failure, empty for a success.

    ``seen``: an object of the target's class lies in the joint maps where a goal is, confirmed or not.
    ``summary_bytes``: what each camera offered so that a floor could be chosen. ``trajectory``: (x, y, yaw) after every
    action, ``trajectory_floors`` the floor of each.
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
    seen: bool
    trajectory: list[tuple[float, float, float]] = field(default_factory=list)
    trajectory_floors: list[str] = field(default_factory=list)
    summary_bytes: dict[str, int] = field(default_factory=dict)

    @property
    def floors(self) -> tuple[str, ...]:
        """Those that the robot was on, in order."""
        return tuple(name for name, _ in groupby(self.trajectory_floors))


class FusedCameras:
    """Joint maps in which a floor's cameras are already: static views are fused once for all episodes of a scene."""

    def __init__(self, sight: Sight, config: FusionConfig) -> None:
        self._sight, self._config = sight, config
        self._kept: dict[tuple[str, ...], JointMap] = {}

    def maps_of(self, names: tuple[str, ...]) -> JointMap:
        """Maps of one's own that hold the views of these cameras and nothing else."""
        if names not in self._kept:
            joint = JointMap(self._config)
            _integrate(joint, self._sight, names)
            self._kept[names] = joint
        return copy.deepcopy(self._kept[names])


def run_episode(
    sight: Sight,
    goals: Goals,
    start: Start,
    searcher: Searcher,
    *,
    surveillance: bool = True,
    summaries: bool = True,
    fusion: FusionConfig | None = None,
    fused: FusedCameras | None = None,
    delay_steps: int = 0,
    seed: int = 0,
    on_step: Callable[[int, PosedView, JointMap, MapView, Decision], None] | None = None,
) -> Episode:
    """Searches for ``goals.label`` from ``start``.

    Args:
        summaries: whether the cameras of all floors report what they last saw.
        fused: made with the same sight and fusion settings; spares fusing the first floor's cameras.
        delay_steps: so many actions after its invocation a camera's views arrive.
        seed: the luck of this episode's perception.
        on_step: ``on_step(step, view, joint, maps, decision)`` may look on.
    """
    began_s = time.perf_counter()
    navigation = sight.building.navigation
    state = robot.RobotState(*start.p_m, start.floor, start.yaw_rad)
    stairs = tuple(robot.stairs_of(navigation))
    reports = surveillance and summaries and len(navigation.floors) > 1
    reported = sight.by_floor() if reports else _NO_SUMMARIES
    text = sight.backend.embed_texts([f"seems like there is a {goals.label}"])[0]
    tau_z_m = (fusion or FusionConfig()).map.tau_z_m
    joint: JointMap | None = None
    invoked: dict[str, int] = {}
    due: list[tuple[int, tuple[str, ...]]] = []
    robot_bytes = 0
    trajectory, floors = [(state.x_m, state.y_m, state.yaw_rad)], [state.floor]
    while True:
        # active camera invocation (eq. 1)
        seen = sight.robot(state, seed)
        active = active_cameras([seen.view.floor_z_m], sight.infos, tau_z_m) if surveillance else []
        if new := tuple(name for name in active if name not in invoked):
            invoked.update({name: sum(v.offered_bytes for v in sight.camera(name)) for name in new})
            due.append((searcher.steps + delay_steps, new))
        arrived = tuple(name for at, names in due if at <= searcher.steps for name in names)
        due = [(at, names) for at, names in due if at > searcher.steps]
        if joint is None and fused is not None:
            joint = fused.maps_of(arrived)
        else:
            joint = joint or JointMap(fusion)
            _integrate(joint, sight, arrived)
        # joint maps
        placed = joint.integrate(seen.view, seen.perception)
        robot_bytes += seen.offered_bytes
        # waypoint and action
        maps = map_view(joint, placed.floor, text)
        decision = searcher.act(maps, robot_state_view(state, stairs), reported)
        if on_step is not None:
            on_step(state.seq, seen.view, joint, maps, decision)
        # a refused stair leaves the robot where it is: the mission sees that at its next step
        if decision.action and not robot.refusal(state, decision.action, navigation, decision.to_floor):
            state = robot.act(state, decision.action, navigation, decision.to_floor)
            trajectory.append((state.x_m, state.y_m, state.yaw_rad))
            floors.append(state.floor)
        if decision.finished or decision.action is None:
            break
    verdict = judge(goals, state, shortest_path_m=start.shortest_path_m)
    was_seen = _was_seen(joint, goals)
    return Episode(
        verdict, decision.found, searcher.steps, decision.error, reason_of(verdict, decision, was_seen, goals, floors),
        decision.message, time.perf_counter() - began_s, robot_bytes, invoked, was_seen, trajectory, floors,
        {info.camera: sight.summary(info.camera)[1] for info in sight.infos} if reports else {},
    )  # fmt: skip


def _integrate(joint: JointMap, sight: Sight, names: tuple[str, ...]) -> None:
    for name in names:
        for seen in sight.camera(name):
            joint.integrate(seen.view, seen.perception)


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


# --- what went wrong ----------------------------------------------------------------------------------------------

#: Every reason that a search can fail for, and what it means.
REASONS: dict[str, str] = {
    "not_seen": "all was searched, and in the end no object that was called the target lay where one is",
    "seen_and_rejected": "an object lies in the maps where the target is, but it was never trusted",
    "wrong_floor": "the robot was never on a floor with a goal",
    "false_positive": "it stopped at something else",
    "stopped_short": "it stopped within 1 m of a viewpoint, not within 0.1 m",
    "stuck": "the robot could not move on",
    "unreachable": "the target was confirmed, and the planner found no way to it",
    "out_of_steps": "the steps were used up",
}


def reason_of(verdict: Verdict, decision: Decision, seen: bool, goals: Goals, floors: list[str]) -> str:
    """The failure's name, one of ``REASONS``: where in the pipeline it went wrong; empty for a success."""
    if verdict.success:
        return ""
    if decision.found:
        return "stopped_short" if verdict.success_at_1_m else "false_positive"
    if not set(floors) & set(goals.viewpoints):
        return "wrong_floor"
    if decision.error == "not_found":
        return "seen_and_rejected" if seen else "not_seen"
    return decision.error or "not_seen"


def _was_seen(joint: JointMap, goals: Goals) -> bool:
    """Whether an object that was ever taken for the target has its centre in a goal's box, give or take 0.3 m."""
    for floor in joint.floors:
        for record in joint.objects(floor):
            if record.label_scores.get(goals.label, 0.0) <= 0.0:
                continue
            for goal in (*goals.instances, *goals.unreachable):
                low, high = np.array(goal.p_min) - 0.3, np.array(goal.p_max) + 0.3
                if np.all((low <= record.center_m) & (record.center_m <= high)):
                    return True
    return False
