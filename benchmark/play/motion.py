"""How the robot of an episode carries out decisions: by discrete actions without noise, or by driving to waypoints."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal, Protocol

import msgspec

from surveilnav.messages import RobotDescription, WaypointPose, WaypointStatus
from surveilnav.robot_frame import PlanarTransform
from surveilnav.robot_state import RobotState
from surveilnav.services.planner.core import Decision
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.motion.waypoint_driving import is_decision_due
from surveilnav.simulator.world import robot_motion
from surveilnav.simulator.world.continuous_robot import ContinuousRobot
from surveilnav.simulator.world.localisation import LocalisationSettings
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.simulated_nav2 import SimulatedNav2

Drive = Literal["actions", "waypoints"]

_TICK_S = 0.1
_DECISION_PERIOD_S = 1.0  # as the planner's setting
_STATES = {"executing": "driving", "succeeded": "reached", "canceled": "cancelled", "aborted": "failed"}


class LocalisationError(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How wrong a robot that drives to waypoints is about where it is.

    Attributes:
        sigma_m, sigma_deg: standard deviation of each correction by its localisation, once a second.
        drift: share of the way by which its odometry is wrong in between.
        frame_m, frame_deg: how wrong the place of its map in the building is, along x, and its direction.
        jump_m: its localisation jumps by this once it has driven ``jump_after_m``.
    """

    sigma_m: float = 0.0
    sigma_deg: float = 0.0
    drift: float = 0.0
    frame_m: float = 0.0
    frame_deg: float = 0.0
    jump_m: float = 0.0
    jump_after_m: float = 5.0


class Motion(Protocol):
    """The robot of one episode. ``state``: where it is in truth; ``believed``: where it believes to be."""

    @property
    def state(self) -> RobotState: ...

    @property
    def believed(self) -> RobotState: ...

    @property
    def waypoint(self) -> WaypointStatus | None:
        """How far it has come with its newest waypoint."""

    def act(self, decision: Decision) -> bool:
        """Carries out a decision, up to the next one. False: the robot refused it."""


class ActionMotion:
    """Habitat's robot: one action at a time, exactly as far as commanded, and it knows where it is."""

    waypoint: WaypointStatus | None = None

    def __init__(self, navigation: NavigationMap, start: RobotState) -> None:
        self._navigation, self.state = navigation, start

    @property
    def believed(self) -> RobotState:
        return self.state

    def act(self, decision: Decision) -> bool:
        action, to_floor = decision.action, decision.to_floor
        if not action or robot_motion.refusal(self.state, action, self._navigation, to_floor):
            return False
        self.state = robot_motion.act(self.state, action, self._navigation, to_floor)
        return True


class WaypointMotion:
    """A robot that drives to waypoints by itself, with a localisation of its own. It takes stairs as Habitat's robot does."""

    def __init__(self, navigation: NavigationMap, start: RobotState, error: LocalisationError, seed: int) -> None:
        self._navigation, self._error = navigation, error
        settings = LocalisationSettings(
            T_building_map=PlanarTransform(error.frame_m, 0.0, math.radians(error.frame_deg)),
            drift=error.drift,
            sigma_m=error.sigma_m,
            sigma_yaw_rad=math.radians(error.sigma_deg),
        )
        self._robot = ContinuousRobot(navigation, start, localisation=settings, seed=seed)
        self._nav2 = SimulatedNav2(self._robot)
        self._config = PlannerConfig(drive="waypoints")
        self._counted = start  # seq, steps, mission, and what the last action was
        self._waypoint_id = ""
        self._has_jumped = error.jump_m == 0.0

    @property
    def state(self) -> RobotState:
        at, counted = self._robot.state, self._counted
        return replace(
            at,
            seq=counted.seq,
            steps=counted.steps,
            last_action=counted.last_action,
            stopped=counted.stopped,
            collided=False,
        )

    @property
    def believed(self) -> RobotState:
        pose = self._robot.localisation.pose  # in its map, which is taken for the building's frame
        return replace(self.state, x_m=pose.x_m, y_m=pose.y_m, yaw_rad=pose.yaw_rad)

    @property
    def waypoint(self) -> WaypointStatus | None:
        goal = self._nav2.goal
        if goal is None or not self._waypoint_id:
            return None
        return WaypointStatus(
            id=self._waypoint_id,
            state=_STATES[goal.status],  # type: ignore[arg-type]
            why=goal.why,
            remaining_m=goal.distance_remaining_m,
        )

    def act(self, decision: Decision) -> bool:
        if decision.waypoint_pose is not None:
            self._drive(decision.waypoint_pose)
        elif decision.action == "take_stairs":
            return self._take_stairs(decision)
        elif decision.action != "stop":
            return False
        self._count(decision.action)
        return True

    def _drive(self, waypoint: WaypointPose) -> None:
        """Drives on until the planner decides again."""
        if waypoint.id != self._waypoint_id:
            self._waypoint_id = waypoint.id
            self._nav2.send(PlanarTransform(waypoint.x_m, waypoint.y_m, waypoint.yaw_rad))
        began, elapsed_s = self._robot.localisation.pose, 0.0
        while True:
            self._nav2.advance(_TICK_S)
            elapsed_s += _TICK_S
            self._jump_if_due()
            now, status = self._robot.localisation.pose, self.waypoint
            if is_decision_due(waypoint, status, began, now, elapsed_s, _DECISION_PERIOD_S, self._config):
                return

    def _jump_if_due(self) -> None:
        if not self._has_jumped and self._robot.state.path_m >= self._error.jump_after_m:
            self._has_jumped = True
            self._robot.jump(self._error.jump_m, 0.0)

    def _take_stairs(self, decision: Decision) -> bool:
        state = self.state
        if robot_motion.refusal(state, "take_stairs", self._navigation, decision.to_floor):
            return False
        after = robot_motion.act(state, "take_stairs", self._navigation, decision.to_floor)
        self._robot.carry_to(after)
        self._counted = replace(self._counted, seq=after.seq, steps=after.steps, last_action="take_stairs")
        return True

    def _count(self, action: str | None) -> None:
        counted = self._counted
        self._counted = replace(
            counted, seq=counted.seq + 1, steps=counted.steps + 1, last_action=action, stopped=action == "stop"
        )


def motion_of(
    drive: Drive, navigation: NavigationMap, start: RobotState, error: LocalisationError, seed: int
) -> Motion:
    """The robot of an episode."""
    if drive == "waypoints":
        return WaypointMotion(navigation, start, error, seed)
    return ActionMotion(navigation, start)


def description_of(drive: Drive) -> RobotDescription:
    """What the robot says of itself."""
    return RobotDescription(drive=drive)
