"""Missions: what is asked for, how far it is, and the plan."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from surveilnav.contract import ID_PATTERN
from surveilnav.messages import FINISHED_STATES, MissionAck, MissionStatus, Plan
from surveilnav.services.gateway.core.resources import examples
from surveilnav.services.gateway.core.resources.base import Number, Resource, Text, Time

#: A shorter way so far tells no pace.
_LEAST_WAY_M = 1.0


class NewMission(BaseModel):
    """Find ``target``."""

    model_config = ConfigDict(
        extra="forbid", str_strip_whitespace=True, json_schema_extra={"example": examples.NEW_MISSION}
    )

    target: str = Field(
        min_length=1, max_length=200, description="what to find: 'potted plant', 'sofa', 'Fernseher', ..."
    )
    robot: str | None = Field(default=None, pattern=ID_PATTERN, description="which robot; null: any free one")
    max_steps: int = Field(default=500, ge=1, le=100_000, description="give up after so many actions")
    queue: bool = Field(default=False, description="wait for a robot if none is free, instead of a refusal")


class Mission(Resource):
    model_config = ConfigDict(json_schema_extra={"example": examples.MISSION})

    id: str = Field(validation_alias="mission")
    target: str = Field(description="as perception calls it: 'tv' for 'Fernseher'")
    asked: Text = Field(default=None, description="as who asked called it, where that is otherwise")
    robot: Text
    state: str = Field(description="queued, active, confirming, paused, done, failed or cancelled")
    phase: str = ""
    step: int = 0
    max_steps: int | None = None
    path_m: Number = None
    distance_remaining_m: Number = Field(default=None, description="the way to the present waypoint")
    time_remaining_s: Number = Field(
        default=None, description="how long that takes at the pace of the mission so far; null: nobody can say"
    )
    elapsed_s: Number = Field(default=None, description="since it was accepted, until its last news")
    floor: Text = None
    found: bool = Field(default=False, description="the planner's belief: it stopped at what it takes for the target")
    judged: bool | None = Field(
        default=None,
        description="where the building is simulated: whether the robot stopped where it should; null: nobody can say",
    )
    object_id: int | None = None
    error: Text = Field(default=None, description="the name of the failure")
    message: str = ""
    started: Time = Field(default=None, validation_alias="started_ns")
    finished: Time = Field(default=None, validation_alias="finished_ns")
    floor_choice_bytes: int = Field(
        default=0, description="what the cameras' summaries cost, by which the floor is chosen"
    )

    @classmethod
    def from_status(
        cls, status: MissionStatus, seen_ns: int, planner_alive: bool, judged: bool | None = None
    ) -> Mission:
        """A mission as its planner tells of it. What is finished stays true without its planner. ``judged``: what a simulator
        says of the robot's stop, which counts where the mission ended by it."""
        stale = status.state not in FINISHED_STATES and not planner_alive
        times = {"elapsed_s": elapsed_s(status), "time_remaining_s": time_remaining_s(status)}
        said = judged if status.state in FINISHED_STATES and status.found else None
        return cls.made_of(status, **times, judged=said, last_seen=seen_ns, stale=stale)

    @classmethod
    def from_ack(cls, ack: MissionAck, goal: NewMission, seen_ns: int) -> Mission:
        """A mission just accepted, of which no status was heard yet."""
        asked = {"target": ack.target or goal.target, "robot": ack.robot or goal.robot, "max_steps": goal.max_steps}
        return cls.made_of(ack, **asked, error=None, last_seen=seen_ns, stale=False)


def elapsed_s(status: MissionStatus) -> float | None:
    """Seconds from a mission's start to its end, or to its newest status; None: its times make no sense."""
    until_ns = status.finished_ns or status.stamp_ns
    return (until_ns - status.started_ns) / 1e9 if 0 < status.started_ns <= until_ns else None


def time_remaining_s(status: MissionStatus) -> float | None:
    """How long the way to the present waypoint takes at the mission's pace so far, turns and waits counted; None before it
    has a pace, and where there is no waypoint."""
    elapsed, left_m = elapsed_s(status), status.distance_remaining_m
    if status.state in FINISHED_STATES or elapsed is None or left_m is None or not status.path_m >= _LEAST_WAY_M:
        return None
    return elapsed * left_m / status.path_m


class Place(BaseModel):
    """Something that the planner weighed."""

    kind: str
    x_m: Number
    y_m: Number
    score: Number = Field(description="of an object its chance per metre; of a frontier its rank's score")
    chosen: bool
    note: str = Field(description="why it was chosen, or why it wasn't")
    object_id: int | None


class MissionPlan(Resource):
    model_config = ConfigDict(json_schema_extra={"example": examples.PLAN})

    mission: str
    robot: str
    floor: str
    step: int
    action: str
    why: str = Field(description="what the robot is up to")
    waypoint: Place | None
    path_m: list[tuple[Number, Number]]
    candidates: list[Place] = Field(
        description="what was weighed: the waypoint's rivals, and objects that were left aside"
    )

    @classmethod
    def from_plan(cls, plan: Plan, seen_ns: int, planner_alive: bool) -> MissionPlan:
        """The newest plan of a mission."""
        return cls.made_of(plan, last_seen=seen_ns, stale=not planner_alive)
