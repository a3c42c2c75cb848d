"""The data of the Server-Sent Events: what happened, how something is now, and small pictures of cameras."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from pydantic import BaseModel, Field

from surveilnav.rest.base import Number, Text
from surveilnav.rest.building import Area, Building, Floor, Object
from surveilnav.rest.cameras import Camera
from surveilnav.rest.missions import Mission, MissionPlan, MissionTraffic
from surveilnav.rest.recordings import Recorder, Replay
from surveilnav.rest.removals import Removal
from surveilnav.rest.robots import Robot, Worker
from surveilnav.rest.system import Readiness, Service, SourceTraffic, Traffic

#: The kinds of events of /live, and the resource that each carries. Of `traffic`, "total" is a ``Traffic``.
LIVE_RESOURCES: dict[str, type[BaseModel]] = {
    "building": Building,
    "readiness": Readiness,
    "floor": Floor,
    "area": Area,
    "camera": Camera,
    "robot": Robot,
    "worker": Worker,
    "recorder": Recorder,
    "service": Service,
    "mission": Mission,
    "plan": MissionPlan,
    "cost": MissionTraffic,
    "object": Object,
    "traffic": SourceTraffic,
    "replay": Replay,
    "removal": Removal,
}


class StreamData(BaseModel):
    """What every stream may send beside its own data: a `reset`, which says that the reader has to begin anew."""

    why: Text = Field(default=None, description="of a reset: why earlier events can't be had")
    do: Text = Field(default=None, description="of a reset: what the reader should do")


class Event(StreamData):
    """Something that happened. Fields that don't belong to its kind are left out of the JSON."""

    id: str = Field(default="", description="of the mission, object, camera, robot, process, node or removal")
    what: str = Field(default="", description="what happened to it")
    time: datetime | None = Field(default=None, description="when the gateway heard of it")
    floor: Text = None
    target: Text = None
    label: Text = None
    robot: Text = None
    source: Text = None
    state: Text = None
    phase: Text = None
    step: int | None = None
    found: bool | None = None
    error: Text = None
    confidence: Number = None
    center_m: tuple[Number, Number, Number] | None = None
    restarts: int | None = None
    message: Text = None


class LiveState(StreamData):
    """How one thing is now."""

    id: str = ""
    state: Any = Field(default=None, description="the resource, of the event's kind; null: it is gone")

    @classmethod
    def of_kind(cls, kind: str, data: dict[str, Any]) -> LiveState:
        """The data of an event of /live, with its ``state`` as the resource of that kind; of a new kind as it came."""
        found = cls.model_validate(data)
        model = Traffic if (kind, found.id) == ("traffic", "total") else LIVE_RESOURCES.get(kind)
        if model is not None and found.state is not None:
            found.state = model.model_validate(found.state)
        return found


class Tile(BaseModel):
    """A small picture of a view, or why there is none."""

    camera: str
    view: int
    jpeg: str | None = Field(default=None, description="the picture in Base64")
    problem: str | None = Field(default=None, description="the name of the problem, where there is no picture")
    detail: str | None = None


class TileState(StreamData):
    """The newest small picture of a view."""

    id: str = Field(default="", description="camera/view")
    state: Tile | None = Field(default=None, description="null: nobody wants it any more")
