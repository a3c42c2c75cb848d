"""Missions: what is asked for, how far the search is, its plan, and what it has cost."""

from __future__ import annotations

from datetime import datetime

from pydantic import BaseModel, ConfigDict, Field

from surveilnav.rest import examples
from surveilnav.rest.base import ID_PATTERN, Number, Resource, Text
from surveilnav.rest.system import LinkTraffic

#: The states of a mission that has ended; the same as ``surveilnav.messages.FINISHED_STATES``.
FINISHED_STATES = ("done", "failed", "cancelled")


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
    """A search for one object by one robot."""

    model_config = ConfigDict(json_schema_extra={"example": examples.MISSION})

    id: str
    target: str = Field(description="as perception calls it: 'tv' for 'Fernseher'")
    asked: Text = Field(default=None, description="the word that was typed, where perception has another for it")
    robot: Text
    state: str = Field(description="queued, active, confirming, paused, done, failed or cancelled")
    phase: str = ""
    step: int = 0
    max_steps: int | None = None
    path_m: Number = None
    distance_remaining_m: Number = Field(default=None, description="the length of the path to the present waypoint")
    time_remaining_s: Number = Field(
        default=None,
        description="how long the path to the waypoint takes at the pace of the mission so far; null: not known",
    )
    elapsed_s: Number = Field(default=None, description="since it was accepted, until its newest status")
    floor: Text = None
    found: bool = Field(
        default=False, description="the planner believes so: it stopped at what it takes for the target"
    )
    judged: bool | None = Field(
        default=None,
        description="where the building is simulated: whether the robot stopped where it should; null: not known",
    )
    object_id: int | None = None
    error: Text = Field(default=None, description="the name of the failure")
    message: str = ""
    request_id: Text = Field(
        default=None, description="of the request that began it; all log lines about the mission have it"
    )
    started: datetime | None = None
    finished: datetime | None = None
    floor_choice_bytes: int = Field(
        default=0, description="the size of the cameras' summaries by which the floor was chosen"
    )

    @property
    def has_ended(self) -> bool:
        """Whether it is done, failed or cancelled, and won't change any more."""
        return self.state in FINISHED_STATES


class Place(BaseModel):
    """Something that the planner weighed as the robot's next waypoint."""

    kind: str
    x_m: Number
    y_m: Number
    chance: Number = Field(description="that the target is found there, 0 to 1")
    cost_m: Number = Field(
        description="expected way until then, in metres: the way there, and what looking or exploring there takes"
    )
    utility: Number = Field(description="what options are compared by: usually chance / cost_m; the highest is chosen")
    chosen: bool
    note: str = Field(description="why it was chosen, or why it wasn't")
    object_id: int | None


class MissionPlan(Resource):
    """The planner's present plan for a mission."""

    model_config = ConfigDict(json_schema_extra={"example": examples.PLAN})

    mission: str
    robot: str
    floor: str
    step: int
    action: str
    why: str = Field(description="what the robot is doing")
    waypoint: Place | None
    path_m: list[tuple[Number, Number]]
    candidates: list[Place] = Field(
        description="what was weighed: the waypoint's rivals, and objects that were left aside"
    )


class MissionTraffic(Resource):
    """What cameras and robots sent while a mission ran, and a forecast. Pictures for people aren't counted."""

    mission: str
    offered_bytes: int
    delivered_bytes: int
    wire_sent_bytes: int
    alone: bool = Field(
        description="false: other missions ran at the same time, and the bytes of all of them are counted here"
    )
    whole: bool = Field(description="false: the gateway started later than the mission, and missed its beginning")
    links: LinkTraffic = Field(default=LinkTraffic(), description="all that was offered meanwhile, by all processes")
    per_step_bytes: Number = Field(description="offered per step, mean of the newest 20 steps; null before that")
    at_most_bytes: Number = Field(
        description="offered in the end, if the coming steps cost as much and the mission uses all of them"
    )
