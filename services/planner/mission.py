"""One mission: the step-synchronous loop of one robot, on a thread of its own."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, replace
from typing import Any

import msgspec

from surveilnav.bus import Node, Publisher, Refused, Table, clock_ns
from surveilnav.contract import MISSION_PLAN, MISSION_STATUS
from surveilnav.messages import FINISHED_STATES, MissionGoal, MissionStatus, Plan, Revision, RobotStatus
from surveilnav.services.planner.config import PlannerSettings
from surveilnav.services.planner.core import Decision, MapView, MissionState, RobotView, step
from surveilnav.services.planner.floor_maps import FloorMapsClient
from surveilnav.services.planner.pausing import Pause, PausedError
from surveilnav.services.planner.store import PendingAction, SavedMission, Store, StoreError
from surveilnav.services.planner.summaries import Summaries
from surveilnav.services.planner.world import CancelError, LostError, World
from surveilnav.words import canonical

#: So often in a row a robot may refuse a stair; the core gives the stair up long before.
_MAX_REFUSALS = 5
_PAUSED_LOOK_S = 0.1


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What all missions share: the bus, the settings, what is heard from fusion and the cameras, and the store."""

    node: Node
    settings: PlannerSettings
    revisions: Table[Revision]
    summaries: Summaries
    store: Store


def accepted(goal: MissionGoal, target: str, robot: str, message: str = "") -> SavedMission:
    """A mission that nothing was done for yet. ``robot`` "": it waits for the goal's, or for any; ``message`` says so."""
    now_ns = clock_ns()
    asked = _as_asked(goal) if canonical(goal.target) != target else ""
    return SavedMission(
        status=MissionStatus(
            stamp_ns=now_ns,
            mission=goal.mission,
            target=target,
            robot=robot,
            state="queued",
            phase="queued",
            step=0,
            max_steps=goal.max_steps,
            path_m=0.0,
            started_ns=now_ns,
            message=message,
            asked=asked,
        ),
        wanted_robot=goal.robot,
    )


def _as_asked(goal: MissionGoal) -> str:
    """A goal's target as it was typed, on one line."""
    return " ".join(goal.target.split())


class Mission:
    """A goal and what became of it, new or as the store kept it. ``status`` and ``plan`` are the newest of their kind."""

    def __init__(self, around: Surroundings, saved: SavedMission) -> None:
        self._node, self._settings, self._store = around.node, around.settings, around.store
        self._summaries = around.summaries
        self.status, self.plan, self.robot = saved.status, saved.plan, saved.status.robot
        self._memory = self._remembered(saved)
        self._pending, self._cancel, self._pause = saved.pending, saved.cancel, Pause(saved.paused)
        self.wanted_robot = saved.wanted_robot
        self._robot_path_m = saved.robot_path_m
        self._path_before_m = self.status.path_m - saved.robot_path_m
        self._refusals = 0
        self._ended = threading.Event()
        self.unsaved = False
        self._saving = threading.Lock()  # who cancels writes too, and an older state must not come last
        self._world = World(
            self._node,
            self._settings,
            around.revisions,
            FloorMapsClient(self._node, self.status.target, self._settings.ask_timeout_s),
            self.robot,
            self._hold,
            self._interrupted,
        )
        # what was heard before counts too: the choice stands on it
        heard = sum(self._summaries.received_bytes().values()) - self._summaries.fresh_bytes()
        self._summary_bytes_before = heard - self.status.floor_choice_bytes
        self._statuses: Publisher | None = None
        self._plans: Publisher | None = None
        self._thread = threading.Thread(target=self._run, name=f"mission-{self.id}", daemon=True)
        self._starting = threading.Lock()  # who cancels a mission that waits for a robot may meet its start

    @property
    def id(self) -> str:
        return self.status.mission

    @property
    def finished(self) -> bool:
        return self.status.state in FINISHED_STATES

    def is_of(self, goal: MissionGoal, target: str) -> bool:
        """Whether a goal is that of this mission, sent again. ``target``: as perception calls it now; meanwhile it may know
        other words."""
        said = {self.status.target, self.status.asked} - {""}
        return self.status.max_steps == goal.max_steps and not said.isdisjoint({target, _as_asked(goal)})

    @property
    def waits(self) -> bool:
        """Whether it has no robot yet."""
        return not self.robot and not self.finished

    def save(self) -> None:
        """Writes the mission to the store. Raises StoreError."""
        with self._saving:
            memory = "" if self.finished else self._memory.to_json().decode()
            saved = SavedMission(
                status=self.status,
                plan=self.plan,
                pending=self._pending,
                robot_path_m=self._robot_path_m,
                cancel=self._cancel,
                paused=self._pause.reason,
                wanted_robot=self.wanted_robot,
                memory=memory,
            )
            under_way = not self.finished and self._pending is not None and self._cancel is None
            self._store.save(saved, finished=self.finished, sync=not under_way)

    def announce(self) -> None:
        """Says that it is there; one that has a robot begins, or goes on where the store says that it was."""
        self._statuses = self._node.publisher(MISSION_STATUS, mission=self.id)
        self._plans = self._node.publisher(MISSION_PLAN, mission=self.id)
        self._say()
        if self.robot:
            self._thread.start()

    def give(self, robot: str) -> None:
        """Begins with a robot; one that waited for it. Raises StoreError: that can't be written, so it still waits."""
        with self._starting:
            if not self.waits:
                return
            waiting = self.status
            self._note(robot=robot, message="")
            try:
                self.save()
            except StoreError:
                self.status = waiting
                raise
            self.robot, self._world = robot, replace(self._world, robot=robot)
            self._say()
            self._thread.start()

    def supersede(self, by: str) -> None:
        """Ends a mission that can't be taken up again: its robot has a later one."""
        self._end("failed", error="superseded", message=f"robot {self.robot} was given mission {by!r} meanwhile")
        self._ended.set()

    def save_again(self) -> None:
        """Another try where the store couldn't be written: a mission that ended must not begin again."""
        if self.unsaved and self.finished:  # one under way is written with its next decision
            self._save_or_warn()

    def cancel(self, reason: str, wait_s: float) -> None:
        """Has the robot stop; waits a little for that to have happened."""
        with self._starting:
            self._cancel = reason or "cancelled"
            if self.waits:
                self._end("cancelled", message=self._cancel)
                self._close()
                self._ended.set()
        self._save_or_warn()
        self._ended.wait(wait_s)

    def pause(self, reason: str) -> None:
        """Has the robot stay where it is once its action is done; the status says when that is so."""
        self._pause.begin(reason)
        self._save_or_warn()

    def resume(self) -> None:
        """Has it go on where it was paused."""
        self._pause.end()
        self._save_or_warn()

    def wait_until(self, *, paused: bool, at_most_s: float) -> None:
        """Until its status says that it is paused, or isn't, or that it ended; at most so long."""
        until_s = time.monotonic() + at_most_s
        while (self.status.state == "paused") != paused and not self.finished and time.monotonic() < until_s:
            time.sleep(0.01)

    # --- the loop -------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            self._say(state="active", phase="waiting", message="waiting for the robot's first view in the maps")
            self._search_with_pauses()
        except CancelError:
            if self._node.stopping.is_set():
                return  # nobody hears us any more; the robot's own deadline stops it
            self._stop_robot()
            self._end("cancelled", message=self._cancel or "")
        except LostError as lost:
            self._stop_robot()
            self._end("failed", error=lost.name, message=str(lost))
        except Exception as error:  # a bug must end this mission only, and not in silence
            if self._node.stopping.is_set():
                return  # the session was closed under our feet
            self._node.log.exception("mission failed", mission=self.id)
            self._stop_robot()
            self._end("failed", error="internal", message=f"{type(error).__name__} in the planner; see its log")
        finally:
            self._ended.set()
            if not self._node.stopping.is_set():
                self._close()

    def _close(self) -> None:
        for publisher in (self._statuses, self._plans):
            if publisher is not None:
                publisher.close()

    def _search(self) -> None:
        """Maps that hold observation n -> decision -> action -> observation n + 1, until the mission ends.

        A mission that was interrupted begins with the action that it last decided on: whether the robot had carried it
        out is told by its sequence number.
        """
        while True:
            self._world.check_cancelled()
            if self._pending is None:
                status = self._world.robot_status()
                maps = self._world.maps_with(status.seq)
                self._pending = self._decide(status, maps)
            self._world.check_cancelled()
            if self._carry_out(self._pending):
                return
            self._pending = None

    def _search_with_pauses(self) -> None:
        """The search goes on with the same decision after each pause."""
        while True:
            try:
                return self._search()
            except PausedError:
                self._wait_while_paused()

    def _interrupted(self) -> bool:
        """Whether it was cancelled. PausedError: it is paused."""
        if self._cancel is None:
            self._pause.check()
        return self._cancel is not None

    def _wait_while_paused(self) -> None:
        """CancelError: it was cancelled meanwhile, or the service ends."""
        self._say(state="paused", phase="paused", message=self._pause.reason or "")
        while self._pause.reason is not None:
            if self._cancel is not None or self._node.stopping.is_set():
                raise CancelError
            self._pause.wait(_PAUSED_LOOK_S)
        self._say(state="active", phase="waiting", message="going on")

    def _decide(self, status: RobotStatus, maps: MapView) -> PendingAction:
        """The next action; written to the store, so that it may be sent."""
        robot = self._robot_view(status)
        self._memory, decision = step(
            self._memory, maps, robot, self._settings.core, summaries=self._summaries.by_floor()
        )
        facts = {
            "step": self._memory.step,
            "path_m": self._path_before_m + robot.path_m,
            "floor": status.floor,
            "object_id": decision.object_id,
            "floor_choice_bytes": self._floor_choice_bytes(),
        }
        if not decision.finished:
            facts |= {
                "state": "confirming" if decision.phase == "confirming" else "active",
                "phase": decision.phase,
                "distance_remaining_m": decision.distance_m,
                "message": decision.message,
            }
        self._note(**facts)
        self.plan = self._plan(decision, status, maps)
        self._pending = PendingAction.from_decision(decision, status.seq)
        self._save_or_warn()
        self._tell(self._plans, self.plan)
        if not decision.finished:
            self._tell(self._statuses, self.status)
        return self._pending

    def _robot_view(self, status: RobotStatus) -> RobotView:
        """The robot by its own word; a stair that it refused wasn't its last action."""
        robot = RobotView.from_status(status, self.id, self._world.stairs(status))
        if robot.path_m < self._robot_path_m:  # it forgot its way: it was started anew
            self._path_before_m += self._robot_path_m
        self._robot_path_m = robot.path_m
        return replace(robot, last_action=None, collided=False) if self._refusals else robot

    def _carry_out(self, pending: PendingAction) -> bool:
        """Has the robot do what was decided; True if that ended the mission."""
        if pending.finished:
            if self._concluded(pending):
                return True
            self._memory.reopen()  # the robot stands elsewhere than we thought: look again
            return False
        self._act(pending)
        return False

    def _act(self, pending: PendingAction) -> None:
        action = str(pending.action)
        try:
            self._world.move(action, pending.seq, self.id, pending.to_floor)
        except Refused as refused:
            if refused.name == "halted":  # it may go on when a person says so, not when the robot is released
                self.pause(f"robot {self.robot} is halted: release it, then resume this mission")
                raise PausedError from refused
            self._refusals += 1  # the core counts it against the stair, and chooses again
            if action != "take_stairs" or self._refusals > _MAX_REFUSALS:
                raise LostError("stuck", f"robot {self.robot} refused {action}: {refused}") from refused
            self._hold(f"robot {self.robot} refused {action}: {refused}")
            return
        self._refusals = 0

    def _concluded(self, pending: PendingAction) -> bool:
        """Ends the mission as decided; False if the robot didn't carry out the stop that says "found"."""
        if not pending.found:
            self._stop_robot()
            self._end("failed", error=pending.error, message=pending.message)
            return True
        try:
            if self._world.move("stop", pending.seq, self.id) != pending.seq + 1:
                return False
        except Refused as refused:
            raise LostError("stuck", f"robot {self.robot} refused to stop: {refused}") from refused
        self._end("done", found=True, message=pending.message)
        return True

    def _stop_robot(self) -> None:
        """Tells the robot to stop, once and without insisting: its own deadline does the rest."""
        world = World(
            self._node,
            self._settings.model_copy(update={"robot_timeout_s": 1e-3}),
            self._world.revisions,
            self._world.maps,
            self.robot,
            lambda _: None,
            lambda: False,
        )
        try:
            world.move("stop", world.robot_status().seq, self.id)
        except (LostError, Refused, CancelError) as error:
            self._node.log.warning("couldn't stop the robot", robot=self.robot, error=str(error))

    # --- keeping it -----------------------------------------------------------------------------------------------

    def _remembered(self, saved: SavedMission) -> MissionState:
        """What the core remembered; a planner of another version may have to begin anew, with the steps counted on."""
        status = saved.status
        fresh = MissionState(status.target, max_steps=status.max_steps, step=status.step)
        if not saved.memory:
            return fresh
        try:
            return MissionState.from_json(saved.memory.encode())
        except msgspec.MsgspecError as error:
            self._node.log.error("memory_unreadable: the mission begins anew", mission=status.mission, error=str(error))
            return fresh

    def _save_or_warn(self) -> None:
        """A mission under way goes on also where its store is full: it may only not outlive the planner."""
        try:
            self.save()
            self.unsaved = False
        except StoreError as error:
            self.unsaved = True
            self._node.warn_seldom("store_failed: this mission may not survive a restart", error=str(error))

    # --- saying so ------------------------------------------------------------------------------------------------

    def _floor_choice_bytes(self) -> int:
        return sum(self._summaries.received_bytes().values()) - self._summary_bytes_before

    def _hold(self, why: str) -> None:
        if self.status.message != why:
            self._say(phase="waiting", message=why)

    def _note(self, **changes: Any) -> None:
        self.status = msgspec.structs.replace(self.status, stamp_ns=clock_ns(), **changes)

    def _say(self, **changes: Any) -> None:
        self._note(**changes)
        self._tell(self._statuses, self.status)

    def _tell(self, publisher: Publisher | None, message: MissionStatus | Plan) -> None:
        if publisher is not None:
            publisher.put(message)

    def _end(self, state: str, *, error: str = "", message: str = "", found: bool = False) -> None:
        self._note(
            state=state,
            phase="finished",
            error=error,
            message=message,
            found=found,
            finished_ns=clock_ns(),
            distance_remaining_m=None,
            floor_choice_bytes=self._floor_choice_bytes(),
        )
        self._save_or_warn()
        self._tell(self._statuses, self.status)
        self._node.log.info(
            "mission ended",
            mission=self.id,
            state=state,
            error=error,
            message=message,
            floor_choice_bytes=self.status.floor_choice_bytes,
            summary_bytes_by_floor=self._summaries.received_bytes(),
        )

    def _plan(self, decision: Decision, status: RobotStatus, maps: MapView) -> Plan:
        return Plan(
            stamp_ns=clock_ns(),
            mission=self.id,
            robot=self.robot,
            floor=status.floor,
            step=self._memory.step,
            seq=status.seq,
            action=decision.action or "",
            waypoint=decision.waypoint,
            path_m=[(round(x, 3), round(y, 3)) for x, y in decision.path],
            candidates=list(decision.candidates),
            why=decision.message,
            revision=maps.revision,
            pending_views=maps.pending_views,
        )
