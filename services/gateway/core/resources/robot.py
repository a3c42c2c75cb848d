"""Robots and perception workers."""

from __future__ import annotations

from pydantic import Field

from services.gateway.core.resources.base import Number, Resource
from surveilnav.geometry import yaw_of
from surveilnav.messages import RobotStatus, WorkerLoad


class Robot(Resource):
    id: str = Field(validation_alias="robot")
    floor: str
    state: str
    seq: int
    position_m: tuple[float, float, float]
    yaw_rad: float
    mission: str | None
    message: str

    @classmethod
    def from_status(cls, status: RobotStatus, mission: str | None, seen_ns: int, stale: bool) -> Robot:
        """A robot as it tells of itself, and the mission under way that it belongs to."""
        pose = status.T_world_base
        where = {"position_m": pose.translation_m, "yaw_rad": yaw_of(pose.matrix())}
        return cls.made_of(status, **where, mission=mission, last_seen=seen_ns, stale=stale)


class Worker(Resource):
    id: str = Field(validation_alias="worker")
    backend: str
    why: str
    queued: int
    capacity: int
    latency_ms: Number

    @classmethod
    def from_load(cls, load: WorkerLoad, seen_ns: int, stale: bool) -> Worker:
        """A perception worker as it tells of itself."""
        return cls.made_of(load, last_seen=seen_ns, stale=stale)
