"""Missions: find a target."""

from __future__ import annotations

from typing import Literal

import msgspec

from surveilnav.messages.base import Message

MissionStateName = Literal["queued", "active", "confirming", "paused", "done", "failed", "cancelled"]
#: States that a mission never leaves.
FINISHED_STATES: tuple[MissionStateName, ...] = ("done", "failed", "cancelled")


class MissionGoal(Message, frozen=True, kw_only=True):
    """Find ``target`` with ``robot`` (empty: any free one). ``queue``: wait for it if it is busy, instead of a refusal."""

    mission: str
    target: str
    robot: str = ""
    max_steps: int = 500
    queue: bool = False


class MissionAck(Message, frozen=True, kw_only=True):
    """Answer to a goal, a pause or a cancel: taken or refused, with the error's name and text. ``target``: what the mission
    looks for, as perception calls it."""

    mission: str
    accepted: bool
    state: MissionStateName
    robot: str = ""
    target: str = ""
    error: str = ""
    message: str = ""


class MissionCancel(Message, frozen=True, kw_only=True):
    """Cancel a mission; its robot stops."""

    mission: str
    reason: str = ""


class MissionPause(Message, frozen=True, kw_only=True):
    """Pauses a mission (its robot ends its action and stays where it is), or (not ``paused``) has it go on."""

    mission: str
    paused: bool
    reason: str = ""


class MissionStatus(Message, frozen=True, kw_only=True):
    """State and feedback of a mission. ``phase`` is for people: waiting, scanning, exploring, approaching, ...

    ``target``: as perception calls it ("tv"); ``asked``: as who asked called it ("Fernseher"), where that is otherwise.
    ``floor_choice_bytes``: what the cameras' summaries, of all floors, cost so far: the price of choosing the floor.
    """

    mission: str
    target: str
    robot: str
    state: MissionStateName
    phase: str
    step: int
    max_steps: int
    path_m: float
    floor: str = ""
    distance_remaining_m: float | None = None
    found: bool = False
    object_id: int | None = None
    error: str = ""
    message: str = ""
    started_ns: int = 0
    finished_ns: int = 0
    floor_choice_bytes: int = 0
    asked: str = ""


class Candidate(msgspec.Struct, frozen=True):
    """A place the planner weighed: kind, (x, y) in the world, score, and why it was or wasn't taken."""

    kind: Literal["target", "candidate", "frontier", "stairs", "second_look"]
    x_m: float
    y_m: float
    score: float
    chosen: bool = False
    note: str = ""
    object_id: int | None = None


class Plan(Message, frozen=True, kw_only=True):
    """The planner's present plan: waypoint, path (x, y in the world, metres), and what else it weighed.

    ``why``: what the robot is up to, for people. ``candidates``: also objects that were left aside, each with why.
    ``revision``, ``pending_views``: of the maps that it was decided on, and how many views of cameras were still to come then.
    """

    mission: str
    robot: str
    floor: str
    step: int
    seq: int
    action: str
    waypoint: Candidate | None
    path_m: list[tuple[float, float]]
    candidates: list[Candidate]
    why: str = ""
    revision: int = 0
    pending_views: int = 0
