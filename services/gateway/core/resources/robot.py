"""Robots and perception workers."""

from __future__ import annotations

from msgspec.structs import asdict
from pydantic import BaseModel, ConfigDict, Field

from surveilnav.geometry import yaw_of
from surveilnav.histogram import quantile_ms
from surveilnav.messages import RobotStatus, WorkerLoad
from surveilnav.services.gateway.core.resources import examples
from surveilnav.services.gateway.core.resources.base import Number, Resource


class Robot(Resource):
    model_config = ConfigDict(json_schema_extra={"example": examples.ROBOT})

    id: str = Field(validation_alias="robot")
    floor: str
    state: str
    seq: int
    position_m: tuple[float, float, float]
    yaw_rad: float
    mission: str | None
    message: str
    notes: list[str] = Field(default_factory=list, description="what to know of where it can go")

    @classmethod
    def from_status(cls, status: RobotStatus, mission: str | None, seen_ns: int, stale: bool) -> Robot:
        """A robot as it tells of itself, and the mission under way that it belongs to."""
        pose = status.T_world_base
        where = {"position_m": pose.translation_m, "yaw_rad": yaw_of(pose.matrix())}
        return cls.made_of(status, **where, mission=mission, last_seen=seen_ns, stale=stale)


class RobotHalt(BaseModel):
    """What a robot answered to be stopped or released."""

    robot: str
    halted: bool | None = Field(description="whether it is halted now; null: it didn't say")
    stale: bool = Field(description="it left the bus, so nobody could ask it")


class StageTimes(BaseModel):
    views: int
    p50_ms: Number
    p95_ms: Number


class Target(BaseModel):
    """Something that can be searched for by this name. Words that mean it are understood, too."""

    model_config = ConfigDict(json_schema_extra={"example": {"name": "tv", "workers": ["perception-1"]}})

    name: str
    workers: list[str] = Field(description="the perception workers that have this name")


class Worker(Resource):
    id: str = Field(validation_alias="worker")
    backend: str
    why: str
    queued: int
    capacity: int
    latency_ms: Number
    calibrated: bool = Field(description="its detections have chances; else raw scores stand for them")
    ready: bool = Field(description="its answer to a probe picture was well-formed")
    cached: int = Field(description="views whose answer was known")
    models: dict[str, str] = Field(description="ids of its detector, segmenter and embedder")
    stages: dict[str, StageTimes] = Field(description="how long views waited (queue) and took, by stage")

    @classmethod
    def from_load(cls, load: WorkerLoad, seen_ns: int, stale: bool) -> Worker:
        """A perception worker as it tells of itself."""
        stages = {
            name: StageTimes(views=sum(counts), p50_ms=quantile_ms(counts, 0.5), p95_ms=quantile_ms(counts, 0.95))
            for name, counts in load.times.items()
        }
        return cls.made_of(load, models=asdict(load.models), stages=stages, last_seen=seen_ns, stale=stale)
