"""The requests of a mission whose robot drives to waypoints by itself, and observes its surroundings while it drives."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from surveilnav.bus import Unanswered
from surveilnav.messages import CommandReply, Revision, RobotStatus, WaypointPose
from surveilnav.robot_frame import PlanarTransform
from surveilnav.services.planner.core import FloorMaps, PlannerConfig
from surveilnav.services.planner.core.motion.waypoint_driving import is_decision_due
from surveilnav.services.planner.mission_bus import MissionBus

_WATCH_S = 0.1


@dataclass(frozen=True, slots=True)
class WaypointBus(MissionBus):
    """A ``MissionBus`` for such a robot. Its commands can be repeated: the robot knows a waypoint by its id."""

    def newest_maps(self) -> tuple[RobotStatus, FloorMaps]:
        """The maps with an observation that is no older than this call, and the robot's status when they have arrived."""
        while True:
            asked, maps = MissionBus.newest_maps(self)
            status = self.robot_status()  # it has moved on meanwhile
            if status.floor == asked.floor:
                return status, maps

    def _send_until_answered(self, send: Callable[[], CommandReply], seq: int) -> bool:
        """Sends the command until the robot answers. Returns whether it was accepted."""
        began_s = time.monotonic()
        while True:
            try:
                return send().accepted
            except Unanswered as error:
                self._wait_for_robot(began_s, error)

    def wait_for_next_decision(self, waypoint: WaypointPose | None, config: PlannerConfig) -> None:
        """Waits until the next decision is due (``is_decision_due``), while the robot drives."""
        if waypoint is None:
            return
        began_s, began = time.monotonic(), _place_of(self.robot_status())
        while True:
            self._pause(_WATCH_S)
            status, elapsed_s = self.robot_status(), time.monotonic() - began_s
            period_s = self.settings.decision_period_s
            if is_decision_due(waypoint, status.waypoint, began, _place_of(status), elapsed_s, period_s, config):
                return

    def hold(self, mission: str) -> None:
        """Has the robot stop where it is, and wait."""
        self.move("drive_to", self.robot_status().seq, mission)

    def _holds(self, revision: Revision, seq: int) -> bool:
        """Whether maps contain observation ``seq`` or, since a newer one replaces it, a later one."""
        return revision.robots.get(self.robot, -1) >= seq

    def _is_other(self, newest_seq: int, seq: int) -> bool:
        """Whether the robot has begun to number anew."""
        return newest_seq < seq


def _place_of(status: RobotStatus) -> PlanarTransform:
    return PlanarTransform.from_matrix(status.T_world_base.matrix())
