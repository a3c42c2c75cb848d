"""What a mission begins with: what all missions share, and its state before the first step."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from surveilnav.bus import Node, Table, clock_ns, request_id
from surveilnav.messages import MissionGoal, MissionStatus, Revision, RobotStatus
from surveilnav.services.planner.areas import BuildingAreas
from surveilnav.services.planner.config import PlannerSettings
from surveilnav.services.planner.core import MissionState
from surveilnav.services.planner.store import SavedMission, Store
from surveilnav.services.planner.summaries import Summaries
from surveilnav.words import canonical


@dataclass(frozen=True, slots=True)
class MissionContext:
    """What all missions share: bus, settings, the latest messages of fusion and the cameras, store, and the building's areas."""

    node: Node
    settings: PlannerSettings
    revisions: Table[Revision]
    summaries: Summaries
    store: Store
    areas: BuildingAreas


def load_state(saved: SavedMission, node: Node) -> MissionState:
    """The core's state from the store; if it can't be read, a fresh one that continues the count of steps."""
    status = saved.status
    fresh = MissionState(status.target, max_steps=status.max_steps, step=status.step)
    if not saved.memory:
        return fresh
    try:
        return MissionState.from_json(saved.memory.encode())
    except msgspec.MsgspecError as error:
        node.log.error("memory_unreadable: the mission begins anew", mission=status.mission, error=str(error))
        return fresh


def new_mission(goal: MissionGoal, target: str, robot: str, message: str = "") -> SavedMission:
    """A mission before its first step. ``robot`` "": it waits for the goal's robot, or for any; ``message`` says why."""
    now_ns = clock_ns()
    asked = as_asked(goal) if canonical(goal.target) != target else ""
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
            request_id=request_id(),
        ),
        wanted_robot=goal.robot,
    )


def lost_mission(robot: RobotStatus) -> SavedMission:
    """The end of a mission that a robot is on, and of which the store knows nothing any more."""
    now_ns = clock_ns()
    return SavedMission(
        status=MissionStatus(
            stamp_ns=now_ns,
            mission=robot.mission,
            target="",
            robot=robot.robot,
            state="failed",
            phase="finished",
            step=0,
            max_steps=1,
            path_m=robot.path_m,
            floor=robot.floor,
            error="mission_lost",
            message=f"robot {robot.robot} is on it, but the planner's store doesn't have it (any more): send the goal again",
            finished_ns=now_ns,
        )
    )


def as_asked(goal: MissionGoal) -> str:
    """The target as the user typed it, on one line."""
    return " ".join(goal.target.split())
