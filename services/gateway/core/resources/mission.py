"""Missions: what is asked for, how far it is, and the plan."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from services.gateway.core.resources.base import Number, Resource, Text, Time
from surveilnav.contract import ID_PATTERN
from surveilnav.messages import FINISHED_STATES, MissionAck, MissionStatus, Plan


class NewMission(BaseModel):
    """Find ``target``."""

    model_config = ConfigDict(extra="forbid", str_strip_whitespace=True)

    target: str = Field(
        min_length=1, max_length=200, description="what to find: 'potted plant', 'sofa', 'Fernseher', ..."
    )
    robot: str | None = Field(default=None, pattern=ID_PATTERN, description="which robot; null: any free one")
    max_steps: int = Field(default=500, ge=1, le=100_000, description="give up after so many actions")


class Mission(Resource):
    id: str = Field(validation_alias="mission")
    target: str = Field(description="as perception calls it: 'tv' for 'Fernseher'")
    asked: Text = Field(default=None, description="as who asked called it, where that is otherwise")
    robot: Text
    state: str = Field(description="queued, active, confirming, done, failed or cancelled")
    phase: str = ""
    step: int = 0
    max_steps: int | None = None
    path_m: Number = None
    distance_remaining_m: Number = None
    floor: Text = None
    found: bool = False
    object_id: int | None = None
    error: Text = Field(default=None, description="the name of the failure")
    message: str = ""
    started: Time = Field(default=None, validation_alias="started_ns")
    finished: Time = Field(default=None, validation_alias="finished_ns")
    floor_choice_bytes: int = Field(
        default=0, description="what the cameras' summaries cost, by which the floor is chosen"
    )

    @classmethod
    def from_status(cls, status: MissionStatus, seen_ns: int, planner_alive: bool) -> Mission:
        """A mission as its planner tells of it. What is finished stays true without its planner."""
        stale = status.state not in FINISHED_STATES and not planner_alive
        return cls.made_of(status, last_seen=seen_ns, stale=stale)

    @classmethod
    def from_ack(cls, ack: MissionAck, goal: NewMission, seen_ns: int) -> Mission:
        """A mission just accepted, of which no status was heard yet."""
        asked = {"target": ack.target or goal.target, "robot": ack.robot or goal.robot, "max_steps": goal.max_steps}
        return cls.made_of(ack, **asked, error=None, last_seen=seen_ns, stale=False)


class Place(BaseModel):
    """Something that the planner weighed."""

    kind: str
    x_m: Number
    y_m: Number
    score: Number
    chosen: bool
    note: str
    object_id: int | None


class MissionPlan(Resource):
    mission: str
    robot: str
    floor: str
    step: int
    action: str
    waypoint: Place | None
    path_m: list[tuple[Number, Number]]
    candidates: list[Place]

    @classmethod
    def from_plan(cls, plan: Plan, seen_ns: int, planner_alive: bool) -> MissionPlan:
        """The newest plan of a mission."""
        return cls.made_of(plan, last_seen=seen_ns, stale=not planner_alive)
