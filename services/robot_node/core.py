"""The robot node's own rules, whatever body it has: what it does while halted, and which status it reports."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from surveilnav.geometry import Pose
from surveilnav.messages import RobotDescription, RobotStatus, Stair, WaypointStatus
from surveilnav.robot_state import RobotState

_HABITAT_ROBOT = RobotDescription()

StateName = Literal["ready", "moving", "stopped", "halted", "error"]


@dataclass(frozen=True, slots=True)
class HaltState:
    """Whether somebody stopped the robot by hand, and why. It stays halted until it is released, whatever is commanded."""

    halted: bool = False
    reason: str = ""

    def refusal(self, action: str) -> str:
        """Why an action isn't carried out, as a sentence for people; empty if it is. ``stop`` is always allowed."""
        if not self.halted or action == "stop":
            return ""
        return f"the robot is halted ({self.reason or 'no reason was given'}): release it first"


#: A robot that observes while it drives takes a new view after it has moved or turned by this much. More views from one place
#: would count as more evidence, but show the same; so one that stands still takes a view only now and then.
_NEW_VIEW_M, _NEW_VIEW_RAD, _STANDING_PERIOD_S = 0.15, math.radians(10.0), 5.0


def is_view_due(last: RobotState | None, now: RobotState, elapsed_s: float, period_s: float) -> bool:
    """Whether a robot that drives to waypoints by itself is to observe again.

    Args:
        last: its state at the last observation; None: there was none.
        elapsed_s: time since then. ``period_s``: the least time between two observations.
    """
    if last is None:
        return True
    turned_rad = abs(math.remainder(now.yaw_rad - last.yaw_rad, 2 * math.pi))
    moved = math.dist(now.p_world, last.p_world) >= _NEW_VIEW_M or turned_rad >= _NEW_VIEW_RAD
    return elapsed_s >= (period_s if moved else max(period_s, _STANDING_PERIOD_S))


def reported_state(state: RobotState, halt: HaltState, *, deadline_missed: bool, awaiting_command: bool) -> StateName:
    """What the robot reports to be doing.

    Args:
        deadline_missed: no command came before the deadline of the last one.
        awaiting_command: the last command's deadline hasn't passed yet, so the next one is expected.
    """
    if halt.halted:
        return "halted"
    if state.stopped or deadline_missed:
        return "stopped"
    return "moving" if awaiting_command else "ready"


def status_message(
    state: RobotState,
    *,
    robot: str,
    state_name: StateName = "ready",
    message: str = "",
    stairs: Sequence[Stair] = (),
    notes: Sequence[str] = (),
    stamp_ns: int = 0,
    description: RobotDescription = _HABITAT_ROBOT,
    waypoint: WaypointStatus | None = None,
    battery: float | None = None,
) -> RobotStatus:
    """The status message of a robot in ``state``; the other arguments are fields of ``RobotStatus``."""
    return RobotStatus(
        stamp_ns=stamp_ns,
        robot=robot,
        floor=state.floor,
        seq=state.seq,
        state=state_name,
        pitch_rad=state.pitch_rad,
        T_world_base=Pose.from_matrix(state.base_pose()),
        message=message,
        stairs=list(stairs),
        notes=list(notes),
        mission=state.mission,
        collided=state.collided,
        last_action=state.last_action,  # type: ignore[arg-type]
        path_m=state.path_m,
        description=description,
        waypoint=waypoint,
        battery=battery,
    )
