"""What a mission remembers from one step to the next."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import msgspec

from surveilnav.messages import Candidate, ObjectRecord, WaypointPose
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.inputs import RobotView
from surveilnav.services.planner.core.memory.floor_goal import FloorChange, FloorGoal, StairsCommand
from surveilnav.services.planner.core.memory.floor_memory import DismissedObject, FloorMemory, stairs_name
from surveilnav.services.planner.core.memory.waypoint import CurrentWaypoint

if TYPE_CHECKING:
    from surveilnav.services.planner.core.choice import Choice

#: A move that is cut short ends at the contact, so the obstacle is in the very next cell.
OBSTACLE_AHEAD_M = 0.05


@dataclass(slots=True)
class MissionState:
    """What the planner remembers of a mission. ``step`` works on a copy of it and never changes its argument.

    It holds plain values only: ``to_json`` and ``from_json`` give an equal state, and a mission resumed from it decides as
    one that was never interrupted.

    Attributes:
        step: actions decided so far; stairs count as many as moves of their length.
        floor: where the robot was at the last step, "" before the first.
        last_moved: (x, y, step): where and at which mission step the robot last got somewhere.
        recoveries: attempts since then to get a stuck robot moving.
        turns_at_frontier: turns spent at the current frontier on looking at its unexplored side.
        second_look_turns_left: turns left of a second look around.
        stairs_command: set while the robot is taking stairs.
        changes: all stairs taken.
        unreachable_why: why a confirmed target couldn't be reached, for the final message; empty: none was missed.
        removals: what the maps said of removals (``FloorMaps.removals``) at the last step.
        driving_to: where a robot that drives by itself was sent last, unless it was only to turn.
        failed_drives: how often its own navigation gave up a waypoint; ``failed_drive_why``: the last reason.
    """

    target: str
    max_steps: int = 500
    step: int = 0
    floor: str = ""
    floors: dict[str, FloorMemory] = field(default_factory=dict)
    waypoint: CurrentWaypoint | None = None
    last_moved: tuple[float, float, int] | None = None
    recoveries: int = 0
    turns_at_frontier: int = 0
    second_look_turns_left: int = 0
    floor_goal: FloorGoal | None = None
    stairs_command: StairsCommand | None = None
    changes: list[FloorChange] = field(default_factory=list)
    unreachable_why: str = ""
    finished: bool = False
    removals: int = 0
    driving_to: WaypointPose | None = None
    failed_drives: int = 0
    failed_drive_why: str = ""

    def __post_init__(self) -> None:
        self.floors.setdefault(self.floor, FloorMemory())

    @property
    def here(self) -> FloorMemory:
        """The memory of the floor that the robot is on."""
        return self.floors[self.floor]

    def copy(self) -> MissionState:
        """A copy whose containers are its own."""
        floors = {name: memory.copy() for name, memory in self.floors.items()}
        return replace(self, floors=floors, changes=list(self.changes))

    def to_json(self) -> bytes:
        return msgspec.json.encode(self)

    @classmethod
    def from_json(cls, data: bytes) -> MissionState:
        """The state that ``to_json`` wrote. Raises msgspec.DecodeError if it isn't one."""
        return msgspec.json.decode(data, type=cls)

    def record_removals(self, removals: int) -> None:
        """Forgets all object ids if a source was taken out of the maps since the last step, because they mean other objects."""
        if removals == self.removals:
            return
        self.removals = removals
        for memory in self.floors.values():
            memory.forget_objects()
        if self.waypoint is not None and self.waypoint.object_id is not None:
            self.waypoint = None

    # --- where the robot is ---------------------------------------------------------------------------------------

    def record_robot(self, robot: RobotView, config: PlannerConfig) -> None:
        """Records the robot's floor and place, and what it bumped into."""
        self._update_floor(robot)
        self._update_place(robot, config)
        self._update_drive(robot, config)

    def _update_floor(self, robot: RobotView) -> None:
        """On a new floor, forgets the waypoint on the old one and keeps the old floor's memory.

        If the robot was told to take stairs and is still on the same floor, the stairs were refused.
        """
        command, self.stairs_command = self.stairs_command, None
        if self.floor == robot.floor:
            if command is not None:
                self.record_stairs_failure(command.x_m, command.y_m)
                self.step -= command.n_steps - 1
            return
        if self.floor:
            why = self.floor_goal.why if command and self.floor_goal else "it was taken there"
            self.changes.append(FloorChange(self.step, self.floor, robot.floor, why))
        else:
            del self.floors[""]
        self.floor = robot.floor
        self.floors.setdefault(robot.floor, FloorMemory()).visits += 1
        self.waypoint, self.last_moved, self.recoveries = None, None, 0
        self.turns_at_frontier, self.second_look_turns_left = 0, 0
        if self.floor_goal and self.floor_goal.to_floor == robot.floor:
            self.floor_goal = None

    def _update_place(self, robot: RobotView, config: PlannerConfig) -> None:
        """Records where the robot stands and, if its last move was cut short, the collision.

        A collision closes one heading at one place, and marks the cell ahead as one where the robot's *centre* can't be.
        An obstacle at the robot's rim, inflated by its radius as VLN-Game does, would close every narrow passage at the
        first touch.
        """
        place = robot.x_m, robot.y_m
        collided = robot.collided
        if robot.last_action == "move_forward" and self.here.visited:
            collided |= math.dist(place, self.here.visited[-1]) < 0.4 * config.step_m
        if collided and robot.last_action == "move_forward":
            c, s = math.cos(robot.yaw_rad), math.sin(robot.yaw_rad)
            obstacle = place[0] + c * OBSTACLE_AHEAD_M, place[1] + s * OBSTACLE_AHEAD_M
            self.here.record_bump(*place, robot.yaw_rad, obstacle)
        self.here.visited.append(place)
        if self.last_moved is None or math.dist(place, self.last_moved[:2]) >= 0.8 * config.step_m:
            self.last_moved = (*place, self.step)
            self.recoveries = 0

    def _update_drive(self, robot: RobotView, config: PlannerConfig) -> None:
        """If the robot's own navigation gave up the place that it was sent to, leaves that place alone for a while."""
        current, drive = self.driving_to, robot.waypoint
        if current is None or drive is None or drive.id != current.id or drive.state != "failed":
            return
        self.driving_to = None
        self.failed_drives += 1
        self.failed_drive_why = drive.why
        if self.waypoint is not None and self.waypoint.kind == "target":
            place = f"({self.waypoint.x_m:.1f}, {self.waypoint.y_m:.1f})"
            self.unreachable_why = f"{self.target!r} was seen at {place}, but the robot can't drive there: {drive.why}"
        self.abandon_waypoint(config)

    # --- being stuck ----------------------------------------------------------------------------------------------

    def is_stuck(self, config: PlannerConfig) -> bool:
        """Whether the robot wanted to move and got nowhere for ``stuck_steps`` steps."""
        return self.last_moved is not None and self.step - self.last_moved[2] >= config.stuck_steps

    def reset_stuck_timer(self) -> None:
        """Has a robot that stands still on purpose not count as stuck."""
        if self.last_moved is not None:
            self.last_moved = (*self.last_moved[:2], self.step)

    def begin_recovery(self, config: PlannerConfig) -> None:
        """Has a stuck robot try another waypoint for a while.

        Every other time it forgets its collisions too: they teach the robot where a narrow place lets it through, but may
        also be what shuts it in.
        """
        self.recoveries += 1
        current = self.waypoint
        if current is not None and current.kind != "stairs":
            failures = self.here.blacklist.failures_at(current.x_m, current.y_m, config)
            self.blacklist_place(current.x_m, current.y_m, config, failures=max(1, failures))
        else:
            self.abandon_waypoint(config)
        if self.recoveries % 2 == 0:
            self.here.forget_collisions()
        self.reset_stuck_timer()

    # --- where it goes --------------------------------------------------------------------------------------------

    def apply(self, choice: Choice, config: PlannerConfig) -> None:
        """Makes the chosen option what the robot does from now on, and records what the choice has found out."""
        chosen = choice.chosen
        self._record_if_object_is_left(choice)
        for place in choice.newly_constrained:
            self.here.defer_frontier(*place)
        if choice.searched_chance is not None:
            self.here.record_searched(choice.searched_chance)
        if chosen.is_accepted and chosen.record is not None:
            self.here.accepted_object = chosen.record.id
        if chosen.kind in {
            "frontier",
            "stairs",
            "second_look",
        }:  # on its way to an object it still wants to go to its floor goal
            self.floor_goal = chosen.floor_goal
        self.here.blacklist.release(chosen.x_m, chosen.y_m, self.step, config)
        if chosen.kind != "passage":
            self.commit_to(chosen.to_candidate(chosen=True), config, is_fallback=chosen.is_fallback)

    def _record_if_object_is_left(self, choice: Choice) -> None:
        """If the robot was heading for an object that isn't promising any more, or that exploring outdoes: that it oscillates."""
        current = self.waypoint
        if current is None or current.object_id is None or current.is_fallback:
            return
        lost_promise = not any(option.record is not None and option.is_current for option in choice.compared)
        if lost_promise or choice.chosen.kind == "frontier":
            self.record_oscillation()

    def commit_to(self, chosen: Candidate, config: PlannerConfig, *, is_fallback: bool = False) -> None:
        """Makes a candidate the current waypoint. One that already is keeps its record of progress."""
        current = self.waypoint
        if current is not None and current.is_same_as(chosen, 1.5 * config.same_place_m):
            self.waypoint = replace(current, kind=chosen.kind, x_m=chosen.x_m, y_m=chosen.y_m)
            return
        self.turns_at_frontier = 0
        self.waypoint = CurrentWaypoint(
            chosen.kind, chosen.x_m, chosen.y_m, None, self.step, chosen.object_id, is_fallback
        )

    def update_progress(self, remaining_m: float | None, config: PlannerConfig) -> bool:
        """Records the travel time left to the waypoint [m]; None: no way leads there.

        Returns whether the robot keeps heading for it. Without a way, or without progress for too long, it abandons the
        waypoint.
        """
        current = self.waypoint
        assert current is not None
        updated = current.with_progress(remaining_m, self.step, config)
        if updated is not None:
            self.waypoint = updated
            return True
        if current.kind == "target":
            place = f"({current.x_m:.1f}, {current.y_m:.1f})"
            self.unreachable_why = f"{self.target!r} was seen at {place}, but the robot can't get near it"
        self.abandon_waypoint(config)
        return False

    def abandon_waypoint(self, config: PlannerConfig) -> None:
        """Stops heading for the waypoint, if there is one: blacklists its place, or counts a failure of the stairs."""
        current = self.waypoint
        if current is None:
            return
        if current.kind == "stairs":
            self.record_stairs_failure(current.x_m, current.y_m)
        else:
            self.blacklist_place(current.x_m, current.y_m, config)

    def record_drive(self, pose: WaypointPose, *, is_turn: bool) -> None:
        """Records where a robot that drives by itself is sent; a turn on the spot isn't a place that it may fail to reach."""
        self.driving_to = None if is_turn else pose

    def record_oscillation(self) -> None:
        """Records that the object which the robot was heading for ceased to be promising; it stops heading there."""
        assert self.waypoint is not None
        assert self.waypoint.object_id is not None
        oscillations, object_id = self.here.oscillations, self.waypoint.object_id
        oscillations[object_id] = oscillations.get(object_id, 0) + 1
        self.waypoint = None

    def is_blacklisted(
        self, x_m: float, y_m: float, config: PlannerConfig, *, confirmed: bool = False, permanently: bool = False
    ) -> bool:
        """Whether a place on this floor is blacklisted now, or ``permanently``. ``confirmed``: a confirmed target is there."""
        if permanently:
            return self.here.blacklist.contains_permanently(x_m, y_m, config, confirmed=confirmed)
        return self.here.blacklist.contains(x_m, y_m, self.step, config, confirmed=confirmed)

    def blacklist_place(self, x_m: float, y_m: float, config: PlannerConfig, *, failures: int | None = None) -> None:
        """Blacklists a place on this floor and stops heading for the waypoint; see ``Blacklist.add``."""
        self.waypoint = None
        self.here.blacklist.add(x_m, y_m, self.step, config, failures=failures)

    # --- objects and frontiers ------------------------------------------------------------------------------------

    def dismiss(self, record: ObjectRecord, why: str) -> None:
        """Records that an object isn't the target; the robot stops heading there."""
        if record.id == self.here.accepted_object:
            self.here.accepted_object = None
        self.here.dismissed[record.id] = DismissedObject(record.center_m[0], record.center_m[1], why)
        self.waypoint = None

    def record_unreachable(self, record: ObjectRecord, area: str = "") -> None:
        """Records for the final message that no way leads near a confirmed target; ``area``: in which it stands."""
        x, y, _ = record.center_m
        why = f"the {self.target} at ({x:.1f}, {y:.1f}) stands in {area}, and can't be reached from outside"
        no_way = f"{self.target!r} was seen at ({x:.1f}, {y:.1f}), but no way leads near it"
        self.unreachable_why = why if area else no_way

    def record_turn_at_frontier(self) -> None:
        """Records a turn towards the unexplored side of the current frontier."""
        self.turns_at_frontier += 1

    def record_scan_turn(self) -> None:
        assert self.here.scan_turns_left is not None
        self.here.scan_turns_left -= 1
        self.reset_stuck_timer()

    def set_second_look(self, turns_left: int) -> None:
        """Sets how many turns of the second look around are left."""
        self.second_look_turns_left = turns_left

    # --- floors ---------------------------------------------------------------------------------------------------

    def record_stairs_command(self, x_m: float, y_m: float, n_steps: int) -> None:
        """Records that the robot is told to take the stairs that end here, which counts as ``n_steps`` steps."""
        self.stairs_command = StairsCommand(x_m, y_m, n_steps)
        self.step += n_steps - 1
        self.reset_stuck_timer()

    def record_stairs_failure(self, x_m: float, y_m: float) -> None:
        """Records that the stairs which end here couldn't be reached or taken."""
        self.waypoint = None
        self.here.stairs_failures[stairs_name(x_m, y_m)] = self.here.stairs_failures_at(x_m, y_m) + 1

    # --- its end --------------------------------------------------------------------------------------------------

    def record_decision(self, decision: Decision) -> None:
        """Counts the action decided on, and records whether it ends the mission."""
        self.finished |= decision.finished
        self.step += decision.action is not None

    def reopen(self) -> None:
        """Continues a mission because the robot didn't carry out the stop that was to end it."""
        self.finished = False
