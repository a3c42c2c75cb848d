"""The requests of a mission to other services: the robot's status, maps that contain its newest view, and moves."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import cast

from pydantic import ValidationError

from surveilnav.bus import Node, Refused, Table, Unanswered, clock_ns, keep_request_id
from surveilnav.contract import CAMERA_SEARCH, MAP_REVISION, ROBOT_COMMAND, ROBOT_STATUS
from surveilnav.errors import WireError
from surveilnav.messages import CameraSearch, Command, CommandReply, Revision, RobotStatus, Stair, WaypointPose
from surveilnav.messages.robot import ActionName
from surveilnav.services.planner.config import PlannerSettings
from surveilnav.services.planner.core import FloorMaps, PlannerConfig
from surveilnav.services.planner.floor_maps import FloorMapsClient

_POLL_S = 0.004
_LOOKING_S = 0.05
_ASK_AGAIN_S = 2.0
_MAX_STAIRS = 64
_FARTHEST_M = 10_000.0


class MissionFailedError(Exception):
    """The mission can't go on. ``name`` is one of the contract's failure names."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name


class MissionCancelledError(Exception):
    """Somebody cancelled the mission, or the service ends."""


@dataclass(frozen=True, slots=True)
class MissionBus:
    """Sends the requests of one mission.

    A method that waits returns what it waits for, or raises ``MissionCancelledError``, or ``MissionFailedError`` at its time
    limit. ``report_waiting`` is called with the reason why the robot stands still meanwhile.
    """

    node: Node
    settings: PlannerSettings
    revisions: Table[Revision]
    maps: FloorMapsClient
    robot: str
    report_waiting: Callable[[str], None]
    cancelled: Callable[[], bool]

    def robot_status(self) -> RobotStatus:
        """The robot's status now. MissionFailedError: no valid one arrived for ``robot_timeout_s``."""
        began_s = time.monotonic()
        while True:
            try:
                status = self._ask_robot_status()
                if not (fault := _fault_of(status)):
                    return status
                self.node.reject(ROBOT_STATUS.name, f"robot {self.robot}: {fault}")
                error: Exception = WireError(fault)
            except (Unanswered, Refused) as unanswered:
                error = unanswered
            self._wait_for_robot(began_s, error)

    def frame_problem(self) -> str:
        """Why the robot can't be where it says, by the newest maps; empty: it can."""
        frames = (frame for row in self.revisions.rows() for frame in row.message.frames)
        return next((frame.message for frame in frames if frame.robot == self.robot), "")

    def stairs(self, status: RobotStatus) -> tuple[Stair, ...]:
        """The stairs in the robot's status; invalid ones are left out and counted."""
        kept = tuple(s for s in status.stairs[:_MAX_STAIRS] if _is_stair(s))
        if len(kept) < len(status.stairs):
            dropped = len(status.stairs) - len(kept)
            self.node.reject("stairs", f"robot {self.robot} speaks of {dropped} that can't be, or of too many")
        return kept

    def newest_maps(self) -> tuple[RobotStatus, FloorMaps]:
        """The robot's status, and its floor's maps once they contain the observation that the status names.

        Views of cameras aren't waited for.

        Raises:
            MissionFailedError: perception_down, fusion_down or robot_lost, after ``maps_timeout_s``.
        """
        while True:
            status = self.robot_status()
            if (maps := self._maps_with(status.seq)) is not None:
                return status, maps

    def _maps_with(self, seq: int) -> FloorMaps | None:
        """The maps of the robot's floor, once they contain its observation ``seq``; None if the robot has another by now."""
        began_s = time.monotonic()
        while True:
            revision = self._revision_with(seq, began_s)
            if revision is None:
                return None
            try:
                return self.maps.maps_at(revision, self.robot)
            except (Unanswered, Refused, WireError) as error:
                name, why = self._missing_service(revision, str(error))
                if isinstance(error, Refused) and error.name == "perception_down":
                    name, why = error.name, str(error)
                self._wait_or_fail(began_s, self.settings.maps_timeout_s, name, why)

    def first_look(self, target: str, floor: str, max_s: float) -> None:
        """Has all cameras of a floor look for the target; returns when they have, or after ``max_s``, or if there are none."""
        question = CameraSearch(stamp_ns=clock_ns(), target=target, floor=floor, max_s=max_s)

        def ask() -> None:
            try:
                self.node.ask(CAMERA_SEARCH, question, timeout_s=max_s + self.settings.ask_timeout_s)
            except (Unanswered, Refused) as error:
                self.node.log.info("no first look by cameras", robot=self.robot, why=str(error))

        asking = threading.Thread(target=keep_request_id(ask), name="first-look", daemon=True)
        asking.start()
        while asking.is_alive():  # on a thread of its own, so that cancelling doesn't wait for the cameras
            self._pause(_LOOKING_S)

    def move(
        self,
        action: str,
        seq: int,
        mission: str,
        to_floor: str | None = None,
        waypoint: WaypointPose | None = None,
        found: bool = False,
    ) -> bool:
        """Has the robot carry out one action after observation ``seq``. False: it is at another observation, so it didn't.

        A command whose answer was lost isn't repeated blindly: the robot's sequence number tells whether it was carried out.

        Raises:
            Refused: the robot can't carry it out.
            MissionFailedError: it didn't answer for ``robot_timeout_s``.
        """
        send = partial(self._command, action, seq, mission, to_floor, waypoint, found)
        return self._send_until_answered(send, seq)

    def _send_until_answered(self, send: Callable[[], CommandReply], seq: int) -> bool:
        """See ``move``. ``send`` sends the command once."""
        began_s = time.monotonic()
        while True:
            try:
                return send().seq == seq + 1
            except Unanswered as error:
                self._wait_for_robot(began_s, error)
                newest = self.robot_status().seq
                if newest != seq:
                    return newest == seq + 1

    def wait_for_next_decision(self, waypoint: WaypointPose | None, config: PlannerConfig) -> None:
        """Returns when the next decision is due: at once, since this robot stands still between two actions."""

    def hold(self, mission: str) -> None:
        """Has the robot stop where it is, and wait: this one stands still anyway."""

    def stop_at_once(self, mission: str) -> None:
        """Asks the robot once to stop, also if the mission was cancelled. Otherwise its last command's deadline does."""
        self._send_once("stop", lambda bus: bus.move("stop", bus.robot_status().seq, mission))

    def hold_at_once(self, mission: str) -> None:
        """Asks the robot once to wait where it is, also if the mission is paused."""
        self._send_once("wait", lambda bus: bus.hold(mission))

    def _send_once(self, what: str, send: Callable[[MissionBus], object]) -> None:
        """Sends something that nothing interrupts. A silent robot isn't waited for."""
        settings = self.settings.model_copy(update={"robot_timeout_s": 1e-3})
        try:
            send(replace(self, settings=settings, report_waiting=lambda _: None, cancelled=lambda: False))
        except (MissionFailedError, Refused, MissionCancelledError) as error:
            self.node.log.warning(f"couldn't have the robot {what}", robot=self.robot, error=str(error))

    def _command(
        self, action: str, seq: int, mission: str, to_floor: str | None, waypoint: WaypointPose | None, found: bool
    ) -> CommandReply:
        command = Command(
            stamp_ns=clock_ns(),
            action=cast("ActionName", action),
            seq_expected=seq,
            deadline_ms=round(self._deadline_s(action) * 1000),
            to_floor=to_floor,
            mission=mission,
            waypoint=waypoint,
            found=found,
        )
        reply: CommandReply = self.node.ask(
            ROBOT_COMMAND, command, robot=self.robot, timeout_s=self.settings.ask_timeout_s
        ).message
        return reply

    def _deadline_s(self, action: str) -> float:
        return self.settings.drive_deadline_s if action == "drive_to" else self.settings.command_deadline_s

    def _holds(self, revision: Revision, seq: int) -> bool:
        """Whether maps contain the robot's observation ``seq``, and no later one."""
        return revision.robots.get(self.robot) == seq

    def _is_other(self, newest_seq: int, seq: int) -> bool:
        """Whether the robot's newest observation means that nobody will publish ``seq`` any more."""
        return newest_seq != seq

    def _revision_with(self, seq: int, began_s: float) -> Revision | None:
        """Waits until a floor's maps contain the robot's observation ``seq``; returns the newest revision of that floor.

        None: the robot has another observation by now, as after its restart without its store, so that nobody will ever
        publish this one.
        """
        asked_s = time.monotonic()
        while True:
            rows = [row.message for row in self.revisions.rows()]
            if holding := [r for r in rows if self._holds(r, seq)]:
                return max(holding, key=lambda r: r.stamp_ns)
            now_s = time.monotonic()
            if now_s - asked_s > _ASK_AGAIN_S:  # a published revision is lost if the router restarts
                asked_s = now_s
                for received in self.node.ask_all(MAP_REVISION, timeout_s=self.settings.ask_timeout_s):
                    if self._holds(received.message, seq):
                        return cast("Revision", received.message)
                if self._has_other_observation(seq):
                    return None
            newest = max(rows, key=lambda r: r.stamp_ns, default=None)
            name, why = self._missing_service(
                newest, f"the maps don't hold observation {seq} of robot {self.robot} yet"
            )
            self._wait_or_fail(began_s, self.settings.maps_timeout_s, name, why)

    def _has_other_observation(self, seq: int) -> bool:
        """Whether the robot says so. One that is silent doesn't."""
        try:
            return self._is_other(self._ask_robot_status().seq, seq)
        except (Unanswered, Refused, WireError):
            return False

    def _ask_robot_status(self) -> RobotStatus:
        status: RobotStatus = self.node.ask(
            ROBOT_STATUS, robot=self.robot, timeout_s=self.settings.ask_timeout_s
        ).message
        return status

    def _missing_service(self, revision: Revision | None, otherwise: str) -> tuple[str, str]:
        """Which service is holding up the maps. Returns the failure name for the mission and a message for people."""
        if self.robot not in self.node.alive("robot"):
            return "robot_lost", f"robot {self.robot} has left the bus"
        if not self.node.alive("fusion"):
            return "fusion_down", "fusion is down"
        if not self.node.alive("perception"):
            return "perception_down", "perception is down"
        if revision is not None and not revision.perception_ok:
            return "perception_down", f"perception is down: {revision.message}"
        return "fusion_down", otherwise

    def _wait_for_robot(self, began_s: float, error: Exception) -> None:
        self._wait_or_fail(
            began_s, self.settings.robot_timeout_s, "robot_lost", f"robot {self.robot} is silent: {error}"
        )

    def _wait_or_fail(self, began_s: float, limit_s: float, name: str, why: str) -> None:
        """Sleeps for a moment. MissionFailedError(name, why): more than ``limit_s`` have passed since ``began_s``."""
        waited_s = time.monotonic() - began_s
        if waited_s > limit_s:
            raise MissionFailedError(name, f"{why}; waited {limit_s:g} s")
        if waited_s > self.settings.late_s:
            self.report_waiting(f"holding still: {why}")
        self._pause(_POLL_S)

    def check_cancelled(self) -> None:
        """Raises MissionCancelledError if somebody has cancelled the mission, or the service ends."""
        if self.cancelled() or self.node.stopping.is_set():
            raise MissionCancelledError

    def _pause(self, seconds: float) -> None:
        self.check_cancelled()
        time.sleep(seconds)


def _fault_of(status: RobotStatus) -> str:
    """What is invalid in a robot's status; "" if nothing is."""
    if not math.isfinite(status.pitch_rad):
        return f"expected its camera's pitch in radians, got {status.pitch_rad}"
    if not 0.0 <= status.path_m < math.inf:
        return f"expected the length of its way in metres, 0 or more, got {status.path_m}"
    try:
        PlannerConfig().for_robot(status.description)
    except ValidationError as error:
        fault = error.errors()[0]
        return f"its description can't be: {fault['loc'][0]} {fault['msg']}"
    return ""


def _is_stair(stair: Stair) -> bool:
    """Whether a stair joins two floors at finite places, over a length that can be walked."""
    places = all(math.isfinite(v) and abs(v) < _FARTHEST_M for v in (*stair.at_m, *stair.to_m))
    floors = bool(stair.floor) and bool(stair.to_floor) and stair.floor != stair.to_floor
    return places and floors and 0.0 < stair.length_m < _FARTHEST_M
