"""Runs one mission: the loop of observing, deciding and acting of one robot, on a thread of its own."""

from __future__ import annotations

import threading
import time
from dataclasses import fields, replace

from surveilnav.bus import Refused, bound_request_id, clock_ns
from surveilnav.messages import FINISHED_STATES, MissionGoal, MissionStatus, Plan, RobotDescription, RobotStatus
from surveilnav.services.planner.areas import MissionAreas
from surveilnav.services.planner.core import FloorMaps, RobotView, step
from surveilnav.services.planner.floor_maps import FloorMapsClient
from surveilnav.services.planner.mission_bus import MissionBus, MissionCancelledError, MissionFailedError
from surveilnav.services.planner.mission_report import MissionReport, plan_from_decision
from surveilnav.services.planner.mission_start import MissionContext, as_asked, load_state
from surveilnav.services.planner.pausing import PausedError, Pauses
from surveilnav.services.planner.store import PendingAction, SavedMission, StoreError
from surveilnav.services.planner.waypoint_bus import WaypointBus

#: How often in a row a robot may refuse a stair before the mission fails. The core gives up the stair long before that.
_MAX_REFUSALS = 5


class MissionRunner:
    """Runs one mission: a new one, or one from the store.

    Attributes:
        report: its status and plan, and who publishes them.
        robot: the robot's id; "" while the mission waits for one.
        unsaved: whether the store lacks the latest state.
    """

    def __init__(self, context: MissionContext, saved: SavedMission) -> None:
        self._node, self._settings, self._store = context.node, context.settings, context.store
        self._summaries, self._areas = context.summaries, MissionAreas(context.areas)
        self.report, self.robot = MissionReport(context.node, saved.status, saved.plan), saved.status.robot
        self._state = load_state(saved, self._node)
        self._pending, self._cancel, self._pauses = saved.pending, saved.cancel, Pauses(self._areas, saved)
        self.wanted_robot = saved.wanted_robot
        self._robot_path_m = saved.robot_path_m
        self._path_before_m = self.status.path_m - saved.robot_path_m
        self._refusals = 0
        self._ended = threading.Event()
        self.unsaved = False
        self._saving = (
            threading.Lock()
        )  # cancelling writes from another thread; an older state must not be written last
        self._bus = MissionBus(
            self._node,
            self._settings,
            context.revisions,
            FloorMapsClient(self._node, self.status.target, self._settings.ask_timeout_s),
            self.robot,
            self.report.publish_waiting,
            self._check_interrupted,
        )
        self._config = self._settings.core
        # summaries received before the mission count too: its choices of floor are based on them
        heard = sum(self._summaries.received_bytes().values()) - self._summaries.fresh_bytes()
        self._summary_bytes_before = heard - self.status.floor_choice_bytes
        self._thread = threading.Thread(target=self._run, name=f"mission-{self.id}", daemon=True)
        self._starting = threading.Lock()  # a queued mission may be cancelled while it is being started

    @property
    def status(self) -> MissionStatus:
        """The latest status."""
        return self.report.status

    @property
    def plan(self) -> Plan | None:
        """The latest plan; None before the first decision."""
        return self.report.plan

    @property
    def id(self) -> str:
        return self.status.mission

    @property
    def finished(self) -> bool:
        return self.status.state in FINISHED_STATES

    def matches(self, goal: MissionGoal, target: str) -> bool:
        """Whether a goal is a repetition of the goal of this mission.

        ``target``: the goal's target in perception's present vocabulary, which may have changed since.
        """
        own = {self.status.target, self.status.asked} - {""}
        return self.status.max_steps == goal.max_steps and not own.isdisjoint({target, as_asked(goal)})

    @property
    def is_queued(self) -> bool:
        """Whether the mission waits for a robot."""
        return not self.robot and not self.finished

    def save(self) -> None:
        """Writes the mission to the store. Raises StoreError."""
        with self._saving:
            memory = "" if self.finished else self._state.to_json().decode()
            saved = SavedMission(
                status=self.status,
                plan=self.plan,
                pending=self._pending,
                robot_path_m=self._robot_path_m,
                cancel=self._cancel,
                wanted_robot=self.wanted_robot,
                memory=memory,
            )
            under_way = not self.finished and self._pending is not None and self._cancel is None
            if not self.finished:
                saved = self._pauses.written_into(saved)
            self._store.save(saved, finished=self.finished, sync=not under_way)

    def announce(self) -> None:
        """Publishes the mission's status. If it has a robot, it also starts the loop, from the state that was in the store."""
        self.report.open()
        if self.robot:
            self._thread.start()

    def assign(self, robot: str) -> None:
        """Gives a queued mission a robot and starts it. StoreError: this can't be stored, so the mission stays queued."""
        with self._starting:
            if not self.is_queued:
                return
            waiting = self.status
            self.report.update(robot=robot, message="")
            try:
                self.save()
            except StoreError:
                self.report.status = waiting
                raise
            self.robot, self._bus = robot, replace(self._bus, robot=robot)
            self.report.publish_status()
            self._thread.start()

    def supersede(self, by: str) -> None:
        """Ends a mission that can't be resumed because its robot was given a later one."""
        self._end("failed", error="superseded", message=f"robot {self.robot} was given mission {by!r} meanwhile")
        self._ended.set()

    def end_lost(self) -> None:
        """Tells everybody, and the store, of the end of a mission that the store didn't know."""
        self._save_or_warn()
        self.report.open()
        self.report.close()
        self._ended.set()

    def retry_saving(self) -> None:
        """Writes the end of the mission to the store if that failed before; otherwise a restart would resume the mission."""
        if self.unsaved and self.finished:  # an open mission is written with its next decision anyway
            self._save_or_warn()

    def cancel(self, reason: str, wait_s: float) -> None:
        """Cancels the mission and stops the robot; waits for that, at most ``wait_s``."""
        with self._starting:
            self._cancel = reason or "cancelled"
            if self.is_queued:
                self._end("cancelled", message=self._cancel)
                self.report.close()
                self._ended.set()
        self._save_or_warn()
        self._ended.wait(wait_s)

    def pause(self, reason: str) -> None:
        """Pauses the mission once the current action is done; then its state is "paused"."""
        self._pauses.begin(reason)
        self._save_or_warn()

    def resume(self) -> None:
        """Resumes a paused mission; of a closed passage that it waits for, that says that it can be passed."""
        self._pauses.resume()
        self._save_or_warn()

    def wait_until(self, *, paused: bool, at_most_s: float) -> None:
        """Waits until the mission is paused (``paused`` False: isn't paused) or has ended, for ``at_most_s`` at most."""
        until_s = time.monotonic() + at_most_s
        while (self.status.state == "paused") != paused and not self.finished and time.monotonic() < until_s:
            time.sleep(0.01)

    # --- the loop -------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        with bound_request_id(self.status.request_id):  # everything that the mission asks for belongs to it
            self._search_until_the_end()

    def _search_until_the_end(self) -> None:
        try:
            self.report.publish_status(
                state="active", phase="waiting", message="waiting for the robot's first view in the maps"
            )
            self._search_with_pauses()
        except MissionCancelledError:
            if self._node.stopping.is_set():
                return  # the session is closing; the robot's command deadline stops it
            self._bus.stop_at_once(self.id)
            self._end("cancelled", message=self._cancel or "")
        except MissionFailedError as lost:
            self._bus.stop_at_once(self.id)
            self._end("failed", error=lost.name, message=str(lost))
        except Exception as error:  # a bug must end this mission alone, and visibly
            if self._node.stopping.is_set():
                return  # the session was closed meanwhile
            self._node.log.exception("mission failed", mission=self.id)
            self._bus.stop_at_once(self.id)
            self._end("failed", error="internal", message=f"{type(error).__name__} in the planner; see its log")
        finally:
            self._ended.set()
            if not self._node.stopping.is_set():
                self.report.close()

    def _search(self) -> None:
        """The loop, until the mission ends: wait for maps that contain observation n, decide, act, get observation n + 1.

        A resumed mission starts with the action that was decided on last. By the robot's sequence number, it is known whether
        the robot has carried out that action already.
        """
        status = self._bus.robot_status()
        self._adapt_to(status.description)
        if self._settings.first_look_s and self._state.step == 0 and self._pending is None:
            floor = status.floor
            self.report.publish_waiting(f"the cameras of floor {floor} look for a {self.status.target}")
            self._bus.first_look(self.status.target, floor, self._settings.first_look_s)
        while True:
            self._bus.check_cancelled()
            if self._pending is None:
                status, maps = self._bus.newest_maps()
                if self._pauses.for_frame(self._bus.frame_problem()):
                    raise PausedError
                self._pending = self._decide(status, maps)
            self._bus.check_cancelled()
            if self._pending is not None and self._carry_out(self._pending):
                return
            self._pending = None

    def _adapt_to(self, robot: RobotDescription) -> None:
        """Plans for a robot of this size that drives in this way, from now on."""
        self._config = self._settings.core.for_robot(robot)
        if robot.drive == "waypoints":
            self._bus = WaypointBus(**{field.name: getattr(self._bus, field.name) for field in fields(MissionBus)})

    def _search_with_pauses(self) -> None:
        """Searches; after a pause the search goes on with the decision that it interrupted."""
        while True:
            try:
                return self._search()
            except PausedError:
                self._wait_while_paused()

    def _check_interrupted(self) -> bool:
        """Whether the mission was cancelled. PausedError: it is paused."""
        if self._cancel is None:
            self._pauses.check()
        return self._cancel is not None

    def _wait_while_paused(self) -> None:
        """Waits until the mission is resumed. MissionCancelledError: it was cancelled, or the service ends."""
        self._save_or_warn()
        self._bus.hold_at_once(self.id)
        self.report.publish_status(state="paused", phase="paused", message=self._pauses.reason or "")
        if not self._pauses.wait(lambda: self._cancel is not None or self._node.stopping.is_set()):
            raise MissionCancelledError
        self.report.publish_status(state="active", phase="waiting", message="going on")

    def _decide(self, status: RobotStatus, maps: FloorMaps) -> PendingAction | None:
        """Decides on the next action, and writes it to the store before it is sent to the robot. None: the mission waits."""
        robot = self._robot_view(status)
        self._areas.drop_outdated_vouches()
        maps = replace(maps, areas=self._areas.on_floor(status.floor))
        self._state, decision = step(self._state, maps, robot, self._config, summaries=self._summaries.by_floor())
        facts = {
            "step": self._state.step,
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
        self.report.update(**facts)
        self.report.plan = plan_from_decision(decision, self.status, status, maps, step=self._state.step)
        if decision.waits_for:
            self._pauses.for_passages(decision.message, status.floor, decision.waits_for)
        self._pending = None if decision.waits_for else PendingAction.from_decision(decision, status.seq)
        self._save_or_warn()
        self.report.publish_plan()
        if not decision.finished:
            self.report.publish_updated()
        return self._pending

    def _robot_view(self, status: RobotStatus) -> RobotView:
        """The robot as input of the core. A stair that the robot refused doesn't count as its last action."""
        robot = RobotView.from_status(status, self.id, self._bus.stairs(status))
        if robot.path_m < self._robot_path_m:  # the robot was restarted, and counts from zero
            self._path_before_m += self._robot_path_m
        self._robot_path_m = robot.path_m
        return replace(robot, last_action=None, collided=False) if self._refusals else robot

    def _carry_out(self, pending: PendingAction) -> bool:
        """Carries out a decision; True if that ended the mission."""
        if pending.finished:
            if self._conclude(pending):
                return True
            self._state.reopen()  # the robot had moved on: the decision was for another observation
            return False
        self._act(pending)
        return False

    def _act(self, pending: PendingAction) -> None:
        action = str(pending.action)
        try:
            self._bus.move(action, pending.seq, self.id, pending.to_floor, pending.waypoint)
        except Refused as refused:
            if self._pauses.for_refusal(self.robot, refused):
                raise PausedError from refused
            self._refusals += 1  # the core counts this against the stair and decides again
            if action != "take_stairs" or self._refusals > _MAX_REFUSALS:
                raise MissionFailedError("stuck", f"robot {self.robot} refused {action}: {refused}") from refused
            self.report.publish_waiting(f"robot {self.robot} refused {action}: {refused}")
            return
        self._refusals = 0
        self._bus.wait_for_next_decision(pending.waypoint, self._config)

    def _conclude(self, pending: PendingAction) -> bool:
        """Ends the mission as decided. False: the robot has moved on to another observation and therefore didn't stop."""
        if not pending.found:
            self._bus.stop_at_once(self.id)
            self._end("failed", error=pending.error, message=pending.message)
            return True
        try:
            if not self._bus.move("stop", pending.seq, self.id, found=True):
                return False
        except Refused as refused:
            raise MissionFailedError("stuck", f"robot {self.robot} refused to stop: {refused}") from refused
        self._end("done", found=True, message=pending.message)
        return True

    # --- the store -----------------------------------------------------------------------------------------------

    def _save_or_warn(self) -> None:
        """Writes the mission to the store. If that fails the mission goes on, but may not survive a restart of the planner."""
        try:
            self.save()
            self.unsaved = False
        except StoreError as error:
            self.unsaved = True
            self._node.warn_seldom("store_failed: this mission may not survive a restart", error=str(error))

    def _end(self, state: str, *, error: str = "", message: str = "", found: bool = False) -> None:
        """Ends the mission, writes that to the store and publishes it."""
        floor_choice_bytes = self._floor_choice_bytes()
        self.report.update(
            state=state,
            phase="finished",
            error=error,
            message=message,
            found=found,
            finished_ns=clock_ns(),
            distance_remaining_m=None,
            floor_choice_bytes=floor_choice_bytes,
        )
        self._save_or_warn()
        self.report.publish_updated()
        self._node.log.info(
            "mission ended",
            mission=self.id,
            state=state,
            error=error,
            message=message,
            floor_choice_bytes=floor_choice_bytes,
            summary_bytes_by_floor=self._summaries.received_bytes(),
        )

    def _floor_choice_bytes(self) -> int:
        return sum(self._summaries.received_bytes().values()) - self._summary_bytes_before
