"""Events: what is told of a change."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, Field

from surveilnav.messages import MissionStatus, ObjectRecord, ServiceState
from surveilnav.services.gateway.core.changes import CameraState, Change, RobotSituation
from surveilnav.services.gateway.core.resources.base import Number, Text, Time

#: Remote text is cut: as many events are kept as fit, however long a stranger's messages are.
_LONGEST = 500


def _cut(text: str) -> str:
    return text[:_LONGEST]


class Event(BaseModel):
    """The data of one event. Fields that don't belong to its kind are left out."""

    id: str = Field(description="of the mission, object, camera, robot, process or node")
    what: str = Field(description="what happened to it")
    time: Time = Field(description="when the gateway heard of it")
    floor: Text = None
    target: Text = None
    label: Text = None
    robot: Text = None
    state: Text = None
    phase: Text = None
    step: int | None = None
    found: bool | None = None
    error: Text = None
    confidence: Number = None
    center_m: tuple[Number, Number, Number] | None = None
    restarts: int | None = None
    message: Text = None

    def line(self) -> str:
        """JSON on one line, of what there is to say."""
        return self.model_dump_json(exclude_none=True)

    @classmethod
    def of_mission(cls, change: Change[MissionStatus], now_ns: int) -> Event:
        """A mission came to another state or phase."""
        s = change.now
        return cls(
            id=s.mission,
            what=change.what,
            time=now_ns,
            floor=s.floor,
            target=_cut(s.target),
            robot=s.robot,
            state=s.state,
            phase=_cut(s.phase),
            step=s.step,
            found=s.found,
            error=_cut(s.error),
            message=_cut(s.message),
        )

    @classmethod
    def of_object(cls, change: Change[ObjectRecord], now_ns: int) -> Event:
        """An object was confirmed, rejected, or is open again."""
        o = change.now
        return cls(
            id=str(o.id),
            what=change.what,
            time=now_ns,
            floor=o.floor,
            label=_cut(o.label),
            confidence=o.confidence,
            center_m=o.center_m,
            message=_cut(o.reason),
        )

    @classmethod
    def of_camera(cls, change: Change[CameraState], now_ns: int) -> Event:
        """A camera came or went, or is asked for views."""
        return cls(id=change.id, what=change.what, time=now_ns, floor=change.now.floor)

    @classmethod
    def of_robot(cls, change: Change[RobotSituation], now_ns: int) -> Event:
        """A robot came or fell silent, or does something else."""
        r = change.now
        return cls(id=change.id, what=change.what, time=now_ns, floor=r.floor, state=r.state, message=_cut(r.message))

    @classmethod
    def of_process(cls, change: Change[ServiceState], now_ns: int) -> Event:
        """A process that is kept running ended or was started again."""
        s = change.now
        return cls(id=_cut(change.id), what=change.what, time=now_ns, restarts=s.restarts, message=_cut(s.why))

    @classmethod
    def of_presence(cls, change: Change[Any], now_ns: int) -> Event:
        """A node of a service announced itself or left."""
        return cls(id=change.id, what=change.what, time=now_ns)
