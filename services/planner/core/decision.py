"""What the planner's core answers at each step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from surveilnav.messages import Candidate, WaypointPose

Phase = Literal[
    "scanning", "exploring", "approaching", "confirming", "changing floor", "second look", "waiting", "finished"
]


@dataclass(frozen=True, slots=True)
class Decision:
    """The next action and why.

    Attributes:
        action: one of ``surveilnav.messages.ACTIONS``; None when the mission failed, or waits.
        phase: what the robot is doing.
        message: the reason, for people.
        to_floor: where ``take_stairs`` leads.
        waypoint: the one chosen; None: none was.
        path: (x, y) [m, world] from the robot to the waypoint; ``distance_m``: its length.
        candidates: what the waypoint was compared with, and objects that weren't chosen.
        finished: the mission ends. ``found``: with the target found; the action is then ``stop``.
        error: the failure's name, empty if the mission didn't fail.
        object_id: the object that the waypoint is at, if any.
        waypoint_pose: where the robot is to drive, with the action ``drive_to``.
        waits_for: the ids of closed passages of this floor; once one of them isn't closed any more, the mission decides anew.
    """

    action: str | None
    phase: Phase
    message: str = ""
    to_floor: str | None = None
    waypoint: Candidate | None = None
    path: tuple[tuple[float, float], ...] = ()
    distance_m: float | None = None
    candidates: tuple[Candidate, ...] = ()
    finished: bool = False
    found: bool = False
    error: str = ""
    object_id: int | None = None
    waypoint_pose: WaypointPose | None = None
    waits_for: tuple[str, ...] = ()
