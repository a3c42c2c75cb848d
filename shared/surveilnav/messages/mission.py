"""Messages about missions, each of which searches for a target."""

from __future__ import annotations

from typing import Literal

import msgspec

from surveilnav.messages.base import Message
from surveilnav.mission_states import MissionStateName


class MissionGoal(Message, frozen=True, kw_only=True):
    """Submits a mission.

    Attributes:
        target: what to find.
        robot: id of the robot; empty: any free one.
        max_steps: limit on the robot's steps.
        queue: whether to wait for a busy robot, instead of being refused.
    """

    mission: str
    target: str
    robot: str = ""
    max_steps: int = 500
    queue: bool = False


class MissionAck(Message, frozen=True, kw_only=True):
    """Answer to a goal, a pause or a cancel.

    Attributes:
        target: what the mission searches for, in perception's vocabulary.
        error, message: name and description of the reason why it isn't ``accepted``.
    """

    mission: str
    accepted: bool
    state: MissionStateName
    robot: str = ""
    target: str = ""
    error: str = ""
    message: str = ""


class MissionCancel(Message, frozen=True, kw_only=True):
    """Cancels a mission; its robot stops."""

    mission: str
    reason: str = ""


class MissionPause(Message, frozen=True, kw_only=True):
    """Pauses a mission, whose robot then completes its action and stays where it is; or resumes it, if not ``paused``."""

    mission: str
    paused: bool
    reason: str = ""


class MissionStatus(Message, frozen=True, kw_only=True):
    """State and progress of a mission.

    Attributes:
        target: what it searches for, in perception's vocabulary ("tv").
        asked: the word with which it was submitted ("Fernseher"), if that is another.
        phase: what the robot is doing, for people: waiting, scanning, exploring, approaching, ...
        step, path_m: steps and distance so far.
        distance_remaining_m: length of the path to the present waypoint.
        object_id: the object that was found, or is being approached.
        error, message: name and description of the reason for a failure.
        floor_choice_bytes: bytes of the cameras' summaries so far, of all floors: the cost of choosing the floor.
        request_id: the request that began it, by which the log lines about it are found.
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
    request_id: str = ""


class Candidate(msgspec.Struct, frozen=True):
    """An option of the planner: its kind, (x, y) in the world, utility, and why it was chosen or not.

    Attributes:
        utility: what options are compared by: usually ``chance / cost_m``.
        chance: that the target is found there, 0 to 1. ``cost_m``: the expected way until then, in metres.
    """

    kind: Literal["target", "candidate", "frontier", "stairs", "second_look"]
    x_m: float
    y_m: float
    utility: float = msgspec.field(name="score")  # as in recordings of version 0.1
    chosen: bool = False
    note: str = ""
    object_id: int | None = None
    chance: float | None = None
    cost_m: float | None = None


class Plan(Message, frozen=True, kw_only=True):
    """The planner's present plan.

    Attributes:
        seq: sequence number of the observation that it is based on.
        path_m: (x, y) of the path to the waypoint, in the world.
        candidates: all places that were considered, also objects that were passed over.
        why: what the robot intends, for people.
        revision, pending_views: of the maps that it is based on; see ``Revision``.
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
