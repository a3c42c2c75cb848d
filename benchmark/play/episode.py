"""One search, the services' cores composed in one process: no bus, no clock, the same every time."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import groupby

import numpy as np

from surveilnav.benchmark.play.approach import Approach, approach_of
from surveilnav.benchmark.play.cameras import Cameras, InvokedCameras
from surveilnav.benchmark.play.motion import Drive, LocalisationError, motion_of
from surveilnav.benchmark.play.sight import ROBOT, SeenView, Sight, text_as_sent
from surveilnav.benchmark.policies.policy import Searcher
from surveilnav.messages import ObjectRecord
from surveilnav.perception.prompts import value_prompt
from surveilnav.robot_state import RobotState
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core import FusionConfig, JointMap, active_cameras
from surveilnav.services.fusion.core.removal import Contribution, sources_to_remove, without
from surveilnav.services.fusion.core.views.validation import ViewError
from surveilnav.services.planner.core import Decision, FloorMaps, RobotView
from surveilnav.services.planner.core.goals.objects import chance
from surveilnav.services.robot_node.core import status_message
from surveilnav.simulator.world import robot_motion
from surveilnav.simulator.world.goals import Goals, Start, Verdict, judge

_MISSION = "episode"
KNOWS_ITS_PLACE = LocalisationError()
#: ``on_step(step, view, joint, maps, decision)``.
OnStep = Callable[[int, PosedView, JointMap, FloorMaps, Decision], None]
_NO_SUMMARIES: Mapping[str, Mapping[str, float]] = {}


@dataclass(slots=True)
class EpisodeResult:
    """What came of one search. ``reason`` names the failure, empty for a success.

    ``seen``: an object of the target's class lies in the joint maps where a goal is, confirmed or not.
    ``summary_bytes``: what each camera offered so that a floor could be chosen. ``trajectory``: (x, y, yaw) after every
    action, ``trajectory_floors`` the floor of each. ``approach``: how near it came to a goal, and when.
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
    approach: Approach
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
        return copy.deepcopy(self._kept_maps(names))

    def chance_at_goal(self, goals: Goals, floor_z_m: float) -> float:
        """What the cameras of a floor know before a robot moves: the highest chance that the maps of their views alone give an
        object at a goal of being the target; 0: there is no such object, or it was rejected."""
        names = tuple(active_cameras([floor_z_m], self._sight.infos, self._config.map.tau_z_m))
        joint = _without_wrong_sources(self._kept_maps(names))
        return max((chance(o, goals.label) for o in _objects_at(goals, joint) if o.status != "rejected"), default=0.0)

    def _kept_maps(self, names: tuple[str, ...]) -> JointMap:
        if names not in self._kept:
            joint = JointMap(self._config)
            _integrate(joint, self._sight, names)
            self._kept[names] = joint
        return self._kept[names]


class Episode:
    """A search for ``goals.label`` from ``start``, step by step: sense, fuse, decide, act."""

    def __init__(
        self,
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
        views_per_step: int = 0,
        seed: int = 0,
        cameras: Cameras | None = None,
        on_step: OnStep | None = None,
        drive: Drive = "actions",
        localisation: LocalisationError = KNOWS_ITS_PLACE,
    ) -> None:
        """An episode that can be run once.

        Args:
            summaries: whether the cameras of all floors report what they last saw.
            fused: made with the same sight and fusion settings; spares fusing the first floor's cameras.
            delay_steps: so many actions after its invocation a camera's views arrive.
            views_per_step: so many cameras' views are looked at from one action to the next; 0: all of them at once.
            seed: the luck of this episode's perception.
            cameras: which of their views come when; None: by ``delay_steps`` and ``views_per_step``.
            drive: how the robot moves; ``localisation``: how wrong it then is about where it is.
            on_step: ``on_step(step, view, joint, maps, decision)`` may look on.
        """
        self._began_s = time.perf_counter()
        self._sight, self._goals, self._start, self._searcher = sight, goals, start, searcher
        self._fusion, self._fused, self._seed, self._on_step = fusion, fused, seed, on_step
        self._surveillance, self._all_at_once = surveillance, views_per_step == 0 and cameras is None
        self._cameras = cameras or InvokedCameras(sight, fusion or FusionConfig(), delay_steps, views_per_step)
        self._navigation = sight.building.navigation
        begins = RobotState(*start.p_m, start.floor, start.yaw_rad, mission=_MISSION)
        self._motion = motion_of(drive, self._navigation, begins, localisation, seed)
        self._stairs = tuple(robot_motion.stairs_in(self._navigation))
        self._reports = surveillance and summaries and len(self._navigation.floors) > 1
        self._reported = sight.by_floor() if self._reports else _NO_SUMMARIES
        self._text = text_as_sent(sight.backend, value_prompt(goals.label))
        self._embedding_model = sight.backend.models.embedder
        self._joint: JointMap | None = None
        self._floor = start.floor  # as the maps call it
        self._robot_bytes = 0
        self._refused = False  # whether the robot refused the last action: then that wasn't its last
        self._trajectory: list[tuple[float, float, float]] = []
        self._floors: list[str] = []
        self._path_m: list[float] = []
        self._left_m: list[float] = []  # shortest paths to the nearest viewpoint
        self._record_place()

    def run(self) -> EpisodeResult:
        while True:
            seen, arrived = self.sense()
            joint, maps = self.fuse(seen, arrived)
            decision = self.decide(maps)
            if self._on_step is not None:
                self._on_step(self._motion.state.seq, seen.view, joint, maps, decision)
            self.act(decision)
            if decision.finished or decision.action is None:
                return self._result(joint, decision)

    def sense(self) -> tuple[SeenView, tuple[str, ...]]:
        """What the robot sees, and the cameras whose views arrive now: those of its floor are invoked (eq. 1)."""
        seen = self._sight.robot(self._motion.state, self._seed, self._motion.believed)
        self._robot_bytes += seen.offered_bytes
        if not self._surveillance:
            return seen, ()
        return seen, self._cameras.invoke(seen.view.floor_z_m, self._searcher.steps)

    def fuse(self, seen: SeenView, arrived: tuple[str, ...]) -> tuple[JointMap, FloorMaps]:
        """The joint maps with the cameras' views and the robot's, and what the planner is shown of them."""
        if self._joint is None and self._fused is not None and self._all_at_once:
            self._joint, in_turn = self._fused.maps_of(arrived), iter([seen])
        else:
            self._joint = self._joint or JointMap(self._fusion)
            in_turn = self._cameras.in_turn(self._joint, seen, arrived)
        for view in in_turn:
            floor = _integrate_view(self._joint, view)
            if view is seen:
                self._floor = floor or self._floor
        self._joint = _without_wrong_sources(self._joint)
        maps = floor_maps(
            _maps_with_floor(self._joint, self._floor, seen.view), self._floor, self._text, self._embedding_model
        )
        return self._joint, replace(maps, pending_views=self._cameras.n_pending)

    def decide(self, maps: FloorMaps) -> Decision:
        """The searcher's waypoint and action."""
        motion = self._motion
        status = status_message(motion.believed, robot=ROBOT, stairs=self._stairs, waypoint=motion.waypoint)
        view = RobotView.from_status(status, _MISSION, self._stairs)
        if self._refused:
            view = replace(view, last_action=None, collided=False)
        return self._searcher.act(maps, view, self._reported)

    def act(self, decision: Decision) -> None:
        """Carries it out. A refused stair leaves the robot where it is: the mission sees that at its next step."""
        done = self._motion.act(decision)
        self._refused = decision.action is not None and not done
        if done:
            self._record_place()

    def _record_place(self) -> None:
        state = self._motion.state
        self._trajectory.append((state.x_m, state.y_m, state.yaw_rad))
        self._floors.append(state.floor)
        self._path_m.append(state.path_m)
        self._left_m.append(self._goals.field.at(state.p_world, state.floor))

    def _result(self, joint: JointMap, decision: Decision) -> EpisodeResult:
        verdict = judge(self._goals, self._motion.state, shortest_path_m=self._start.shortest_path_m)
        seen = _was_seen(joint, self._goals)
        cameras = [info.camera for info in self._sight.infos] if self._reports else []
        return EpisodeResult(
            verdict=verdict,
            found=decision.found,
            steps=self._searcher.steps,
            error=decision.error,
            reason=reason_of(verdict, decision, seen, self._goals, self._floors),
            message=decision.message,
            seconds=time.perf_counter() - self._began_s,
            robot_bytes=self._robot_bytes,
            camera_bytes=dict(self._cameras.offered_bytes),
            seen=seen,
            approach=approach_of(self._path_m, self._left_m),
            trajectory=self._trajectory,
            trajectory_floors=self._floors,
            summary_bytes={name: self._sight.summary(name)[1] for name in cameras},
        )


def _without_wrong_sources(joint: JointMap) -> JointMap:
    """The maps without what cameras contributed whose poses turned out to be wrong."""
    for source in sources_to_remove(joint):
        joint = without(joint, Contribution(source))
    return joint


def _integrate(joint: JointMap, sight: Sight, names: tuple[str, ...]) -> None:
    for name in names:
        for seen in sight.camera(name):
            _integrate_view(joint, seen)


def _integrate_view(joint: JointMap, seen: SeenView) -> str:
    """Has the maps take a view, by the same guard as on the bus; the floor that it was taken on, "" if they know none.

    A view before a wall, where not one pixel has a depth, is left out, as on the bus. So are the views of a camera whose
    description is wrong, and one that they hold ("").

    Raises:
        ViewError: a view that can't be.
    """
    try:
        done = joint.accept(seen.view, seen.perception)
    except ViewError as error:
        if error.name not in ("no_depth", "geometry_disagrees", "quarantined", "frame_disagrees"):
            raise
        return joint.floor_at(seen.view.floor_z_m)
    return done.floor if done is not None else ""


def _maps_with_floor(joint: JointMap, floor: str, view: PosedView) -> JointMap:
    """The joint maps, or empty ones where a search begins before a wall: the planner must be able to turn the robot."""
    if joint.knows(floor):
        return joint
    x_m, y_m, _ = view.T_world_camera[:3, 3].tolist()
    return JointMap.unseen(floor, view.floor_z_m, (x_m, y_m), joint.config)


def floor_maps(joint: JointMap, floor: str, text: np.ndarray, embedding_model: str) -> FloorMaps:
    """The planner's view of the joint maps of a floor."""
    grid, occupancy = joint.layer(floor, "occupancy")
    layers = {name: joint.layer(floor, name)[1] for name in ("explored", "frontier")}
    value = joint.layer(floor, "value", text, embedding_model)[1]
    return FloorMaps(
        floor,
        joint.floors[floor],
        grid,
        occupancy,  # type: ignore[arg-type]
        layers["explored"],  # type: ignore[arg-type]
        layers["frontier"],  # type: ignore[arg-type]
        value,  # type: ignore[arg-type]
        joint.objects(floor),
        joint.floor_revision(floor),
    )


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
    """Whether an object that was ever taken for the target lies at a goal."""
    return any(record.label_scores.get(goals.label, 0.0) > 0.0 for record in _objects_at(goals, joint))


def _objects_at(goals: Goals, joint: JointMap) -> Iterator[ObjectRecord]:
    """The objects of the maps that have their centre in a goal's box, give or take 0.3 m."""
    boxes = [(np.array(g.p_min) - 0.3, np.array(g.p_max) + 0.3) for g in (*goals.instances, *goals.unreachable)]
    for floor in joint.floors:
        for record in joint.objects(floor):
            if any(np.all((low <= record.center_m) & (record.center_m <= high)) for low, high in boxes):
                yield record
