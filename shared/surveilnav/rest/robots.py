"""Robots, and the perception workers that look at the pictures."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from surveilnav.rest import examples
from surveilnav.rest.base import Number, Resource


class FrameCorrection(BaseModel):
    """How a robot must be moved and turned from where it says that it is, to be there by what cameras have measured."""

    dx_m: float
    dy_m: float
    dyaw_rad: float


class Robot(Resource):
    """A robot as it reports itself, and the mission that it is on."""

    model_config = ConfigDict(json_schema_extra={"example": examples.ROBOT})

    id: str
    floor: str
    state: str
    seq: int
    position_m: tuple[float, float, float]
    yaw_rad: float
    mission: str | None
    message: str
    frame_problem: str = Field(
        default="",
        description="it isn't where it says, so none of its views is believed while it is so; empty: they are",
    )
    frame_correction: FrameCorrection | None = Field(
        default=None, description="how its place would fit what cameras have measured; null: it does"
    )
    battery: float | None = Field(None, description="how full its battery is, 0 to 1; null: it doesn't say")
    notes: list[str] = Field(default_factory=list, description="which places it can't reach, and why")


class RobotHalt(BaseModel):
    """What a robot answered when it was told to stop, or released."""

    robot: str
    halted: bool | None = Field(description="whether it is halted now; null: it didn't answer")
    stale: bool = Field(description="it left the bus, so it could not be asked")


class StageTimes(BaseModel):
    """How long one stage of a perception worker takes."""

    views: int
    p50_ms: Number
    p95_ms: Number


class Worker(Resource):
    """A perception worker: what it runs, and how busy it is."""

    id: str
    backend: str
    why: str
    queued: int
    capacity: int
    latency_ms: Number
    calibrated: bool = Field(description="its scores are calibrated as chances; false: raw scores take their place")
    ready: bool = Field(description="its answer to a probe picture was well-formed")
    cached: int = Field(description="how many views it answered from its cache")
    models: dict[str, str] = Field(description="ids of its detector, segmenter and embedder")
    stages: dict[str, StageTimes] = Field(description="how long views waited (queue) and took, by stage")


class Target(BaseModel):
    """Something that can be searched for by this name. Words with the same meaning are understood, too."""

    model_config = ConfigDict(json_schema_extra={"example": {"name": "tv", "workers": ["perception-1"]}})

    name: str
    workers: list[str] = Field(description="the perception workers that have this name")
