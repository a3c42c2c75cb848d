"""The requests of a mission whose robot drives to waypoints by itself, and observes its surroundings while it drives."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from surveilnav.bus import Unanswered
from surveilnav.geometry import Pose
from surveilnav.messages import Revision, RobotStatus, WaypointPose
from surveilnav.services.planner.core import FloorMaps, PlannerConfig
from surveilnav.services.planner.mission_bus import MissionBus

_WATCH_S = 0.1
#: A turn on the spot ends before the next decision, unless it takes longer than this.
_TURN_TIMEOUT_S = 15.0


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

    def move(
        self, action: str, seq: int, mission: str, to_floor: str | None = None, waypoint: WaypointPose | None = None
    ) -> bool:
        """Sends a command until the robot answers. Returns whether it was accepted; raises what ``MissionBus.move`` does."""
        began_s = time.monotonic()
        while True:
            try:
                return self._command(action, seq, mission, to_floor, waypoint).accepted
            except Unanswered as error:
                self._wait_for_robot(began_s, error)

    def wait_for_next_decision(self, waypoint: WaypointPose | None, config: PlannerConfig) -> None:
        """Waits until the drive has ended, or the robot has got as far as by one action, or ``decision_period_s`` has passed.

        So a step of the mission means about the same as for a robot of discrete actions. A turn on the spot is waited for.
        """
        if waypoint is None:
            return
        began_s, began = time.monotonic(), self.robot_status()
        x_m, y_m, _ = began.T_world_base.translation_m
        is_turn = math.hypot(waypoint.x_m - x_m, waypoint.y_m - y_m) < config.step_m / 2
        limit_s = _TURN_TIMEOUT_S if is_turn else self.settings.decision_period_s
        while time.monotonic() - began_s < limit_s:
            self._pause(_WATCH_S)
            status = self.robot_status()
            drive = status.waypoint
            if drive is None or drive.id != waypoint.id or drive.state != "driving":
                return
            if not is_turn and _has_moved(began.T_world_base, status.T_world_base, config):
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


def _has_moved(began: Pose, now: Pose, config: PlannerConfig) -> bool:
    T_began, T_now = began.matrix(), now.matrix()
    turned_rad = math.remainder(
        math.atan2(T_now[1, 0], T_now[0, 0]) - math.atan2(T_began[1, 0], T_began[0, 0]), 2 * math.pi
    )
    moved_m = math.dist(T_began[:2, 3], T_now[:2, 3])
    return moved_m >= config.step_m or abs(turned_rad) >= config.turn_rad
