"""Missions and plans as resources, from messages of the planner."""

from __future__ import annotations

from surveilnav import messages as m
from surveilnav.rest import Mission, MissionPlan, NewMission
from surveilnav.services.gateway.core.resources import resource_from, utc

#: A path shorter than this says nothing about the pace of a mission.
_MIN_PATH_M = 1.0


def mission_from_status(
    status: m.MissionStatus, seen_ns: int, planner_alive: bool, judged: bool | None = None
) -> Mission:
    """A mission as its planner reports it. A finished one is never stale: it stays true without its planner.

    ``judged`` is a simulator's verdict on the robot's stop; it counts where the mission ended by that stop.
    """
    finished = status.state in m.FINISHED_STATES
    return resource_from(
        Mission,
        status,
        id=status.mission,
        started=utc(status.started_ns),
        finished=utc(status.finished_ns),
        elapsed_s=elapsed_s(status),
        time_remaining_s=time_remaining_s(status),
        judged=judged if finished and status.found else None,
        last_seen=utc(seen_ns),
        stale=not finished and not planner_alive,
    )


def mission_from_ack(ack: m.MissionAck, goal: NewMission, seen_ns: int, request_id: str) -> Mission:
    """A mission that the planner has just accepted, before its first status."""
    return resource_from(
        Mission,
        ack,
        id=ack.mission,
        target=ack.target or goal.target,
        robot=ack.robot or goal.robot,
        max_steps=goal.max_steps,
        error=None,
        request_id=request_id,
        last_seen=utc(seen_ns),
        stale=False,
    )


def elapsed_s(status: m.MissionStatus) -> float | None:
    """Seconds from a mission's start to its end, or to its newest status; None where its times contradict each other."""
    until_ns = status.finished_ns or status.stamp_ns
    return (until_ns - status.started_ns) / 1e9 if 0 < status.started_ns <= until_ns else None


def time_remaining_s(status: m.MissionStatus) -> float | None:
    """How long the path to the present waypoint takes at the mission's pace so far, which includes turns and waits.

    None while the mission has no pace yet or no waypoint.
    """
    elapsed, left_m = elapsed_s(status), status.distance_remaining_m
    if status.state in m.FINISHED_STATES or elapsed is None or left_m is None or not status.path_m >= _MIN_PATH_M:
        return None
    return elapsed * left_m / status.path_m


def plan_from_message(plan: m.Plan, seen_ns: int, planner_alive: bool) -> MissionPlan:
    return resource_from(MissionPlan, plan, last_seen=utc(seen_ns), stale=not planner_alive)
