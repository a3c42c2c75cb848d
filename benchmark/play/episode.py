"""One search, the services' cores composed in one process: no bus, no clock, the same every time."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import groupby

import numpy as np

from benchmark.play.sight import ROBOT, Sight, Sighted
from benchmark.policies.policy import Searcher
from services.fusion.core import FusionConfig, Integrated, JointMap, active_cameras
from services.fusion.core.guard import ViewError
from services.fusion.core.view_order import FloorWedge, most_worth_first
from services.planner.core import Decision, MapView, RobotView
from services.robot_node import core as robot
from simulator.world.goals import Goals, Start, Verdict, judge
from surveilnav.perception.prompts import value_prompt
from surveilnav.sensing.views import PosedView

_MISSION = "episode"
#: ``on_step(step, view, joint, maps, decision)``.
OnStep = Callable[[int, PosedView, JointMap, MapView, Decision], None]
_NO_SUMMARIES: Mapping[str, Mapping[str, float]] = {}


@dataclass(slots=True)
class EpisodeResult:
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


class _Cameras:
    """Invokes cameras (eq. 1), and knows which of their views are still to come. ``offered_bytes``: by camera invoked."""

    def __init__(self, sight: Sight, config: FusionConfig, delay_steps: int, views_per_step: int) -> None:
        self._sight, self._tau_z_m, self._range_m = sight, config.map.tau_z_m, config.map.explored_range_camera_m
        self._delay_steps, self._views_per_step = delay_steps, views_per_step
        self.offered_bytes: dict[str, int] = {}
        self._due: list[tuple[int, tuple[str, ...]]] = []
        self._waiting: list[tuple[FloorWedge, Sighted]] = []

    def invoke(self, floor_z_m: float, now: int) -> tuple[str, ...]:
        """Invokes the cameras of the robot's floor at step ``now``; the names of those whose views have come since."""
        active = active_cameras([floor_z_m], self._sight.infos, self._tau_z_m)
        if new := tuple(name for name in active if name not in self.offered_bytes):
            self.offered_bytes |= {name: sum(v.offered_bytes for v in self._sight.camera(name)) for name in new}
            self._due.append((now + self._delay_steps, new))
        arrived = tuple(name for at, names in self._due if at <= now for name in names)
        self._due = [(at, names) for at, names in self._due if at > now]
        return arrived

    @property
    def n_pending(self) -> int:
        """How many views of the invoked cameras the maps don't hold yet."""
        return len(self._waiting) + sum(len(self._sight.camera(name)) for _, names in self._due for name in names)

    def wait(self, names: tuple[str, ...]) -> None:
        """Views have come and wait to be looked at."""
        views = [seen for name in names for seen in self._sight.camera(name)]
        self._waiting += [(self._wedge(seen.view), seen) for seen in views]

    def looked_at(self, joint: JointMap, robot_m: tuple[float, float, float]) -> list[Sighted]:
        """The views that perception has time for until the robot's next, those that may show most first."""
        n = self._views_per_step or len(self._waiting)
        if n < len(self._waiting):
            order = most_worth_first(joint, [wedge for wedge, _ in self._waiting], [robot_m])
            self._waiting = [self._waiting[k] for k in order]
        chosen, self._waiting = self._waiting[:n], self._waiting[n:]
        return [seen for _, seen in chosen]

    def _wedge(self, view: PosedView) -> FloorWedge:
        return FloorWedge.of(view.T_world_camera, view.camera, view.floor_z_m, self._range_m)


class Episode:
    """A search for ``goals.label`` from ``start``, step by step: sense, fuse, decide, act."""

    def __init__(
        self, sight: Sight, goals: Goals, start: Start, searcher: Searcher, *, surveillance: bool = True,
        summaries: bool = True, fusion: FusionConfig | None = None, fused: FusedCameras | None = None,
        delay_steps: int = 0, views_per_step: int = 0, seed: int = 0,
        on_step: OnStep | None = None,
    ) -> None:  # fmt: skip
        """An episode that can be run once.

        Args:
            summaries: whether the cameras of all floors report what they last saw.
            fused: made with the same sight and fusion settings; spares fusing the first floor's cameras.
            delay_steps: so many actions after its invocation a camera's views arrive.
            views_per_step: so many cameras' views are looked at from one action to the next; 0: all of them at once.
            seed: the luck of this episode's perception.
            on_step: ``on_step(step, view, joint, maps, decision)`` may look on.
        """
        self._began_s = time.perf_counter()
        self._sight, self._goals, self._start, self._searcher = sight, goals, start, searcher
        self._fusion, self._fused, self._seed, self._on_step = fusion, fused, seed, on_step
        self._surveillance, self._at_once = surveillance, views_per_step == 0
        self._cameras = _Cameras(sight, fusion or FusionConfig(), delay_steps, views_per_step)
        self._navigation = sight.building.navigation
        self._state = robot.RobotState(*start.p_m, start.floor, start.yaw_rad, mission=_MISSION)
        self._stairs = tuple(robot.stairs_of(self._navigation))
        self._reports = surveillance and summaries and len(self._navigation.floors) > 1
        self._reported = sight.by_floor() if self._reports else _NO_SUMMARIES
        self._text = sight.backend.embed_texts([value_prompt(goals.label)])[0]
        self._embedding_model = sight.backend.models.embedder
        self._joint: JointMap | None = None
        self._floor = start.floor  # as the maps call it
        self._robot_bytes = 0
        self._trajectory: list[tuple[float, float, float]] = []
        self._floors: list[str] = []
        self._note_place()

    def run(self) -> EpisodeResult:
        """Plays it to its end."""
        while True:
            seen, arrived = self.sense()
            joint, maps = self.fuse(seen, arrived)
            decision = self.decide(maps)
            if self._on_step is not None:
                self._on_step(self._state.seq, seen.view, joint, maps, decision)
            self.act(decision)
            if decision.finished or decision.action is None:
                return self._result(joint, decision)

    def sense(self) -> tuple[Sighted, tuple[str, ...]]:
        """What the robot sees, and the cameras whose views arrive now: those of its floor are invoked (eq. 1)."""
        seen = self._sight.robot(self._state, self._seed)
        self._robot_bytes += seen.offered_bytes
        if not self._surveillance:
            return seen, ()
        return seen, self._cameras.invoke(seen.view.floor_z_m, self._searcher.steps)

    def fuse(self, seen: Sighted, arrived: tuple[str, ...]) -> tuple[JointMap, MapView]:
        """The joint maps with the cameras' views and the robot's, and what the planner is shown of them."""
        if self._joint is None and self._fused is not None and self._at_once:
            self._joint = self._fused.maps_of(arrived)
        else:
            self._joint = self._joint or JointMap(self._fusion)
            self._cameras.wait(arrived)
            x_m, y_m, _ = seen.view.T_world_camera[:3, 3].tolist()
            for camera_view in self._cameras.looked_at(self._joint, (x_m, y_m, seen.view.floor_z_m)):
                _accepted(self._joint, camera_view)
        if (placed := _accepted(self._joint, seen)) is not None:
            self._floor = placed.floor
        maps = map_view(self._joint, self._floor, self._text, self._embedding_model)
        return self._joint, replace(maps, pending_views=self._cameras.n_pending)

    def decide(self, maps: MapView) -> Decision:
        """The searcher's waypoint and action."""
        status = robot.status_of(self._state, robot=ROBOT, stairs=self._stairs)
        return self._searcher.act(maps, RobotView.from_status(status, _MISSION, self._stairs), self._reported)

    def act(self, decision: Decision) -> None:
        """Carries it out. A refused stair leaves the robot where it is: the mission sees that at its next step."""
        action, to_floor = decision.action, decision.to_floor
        if action and not robot.refusal(self._state, action, self._navigation, to_floor):
            self._state = robot.act(self._state, action, self._navigation, to_floor)
            self._note_place()

    def _note_place(self) -> None:
        self._trajectory.append((self._state.x_m, self._state.y_m, self._state.yaw_rad))
        self._floors.append(self._state.floor)

    def _result(self, joint: JointMap, decision: Decision) -> EpisodeResult:
        verdict = judge(self._goals, self._state, shortest_path_m=self._start.shortest_path_m)
        seen = _was_seen(joint, self._goals)
        cameras = [info.camera for info in self._sight.infos] if self._reports else []
        return EpisodeResult(
            verdict=verdict, found=decision.found, steps=self._searcher.steps, error=decision.error,
            reason=reason_of(verdict, decision, seen, self._goals, self._floors), message=decision.message,
            seconds=time.perf_counter() - self._began_s, robot_bytes=self._robot_bytes,
            camera_bytes=self._cameras.offered_bytes, seen=seen, trajectory=self._trajectory,
            trajectory_floors=self._floors, summary_bytes={name: self._sight.summary(name)[1] for name in cameras},
        )  # fmt: skip


def _integrate(joint: JointMap, sight: Sight, names: tuple[str, ...]) -> None:
    for name in names:
        for seen in sight.camera(name):
            _accepted(joint, seen)


def _accepted(joint: JointMap, seen: Sighted) -> Integrated | None:
    """What the maps made of a view, by the same guard as on the bus; None: they hold it already.

    A search may begin right before a wall, where not one pixel has a depth: such a view is taken all the same, so that there
    are maps to decide on.
    """
    try:
        return joint.accept(seen.view, seen.perception)
    except ViewError as error:
        if error.name != "no_depth":
            raise
        return joint.integrate(seen.view, seen.perception)


def map_view(joint: JointMap, floor: str, text: np.ndarray, embedding_model: str) -> MapView:
    """The planner's view of the joint maps of a floor."""
    grid, occupancy = joint.layer(floor, "occupancy")
    layers = {name: joint.layer(floor, name)[1] for name in ("explored", "frontier")}
    value = joint.layer(floor, "value", text, embedding_model)[1]
    return MapView(
        floor, joint.floors[floor], grid, occupancy, layers["explored"], layers["frontier"], value,  # type: ignore[arg-type]
        joint.objects(floor), joint.floor_revision(floor),
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
