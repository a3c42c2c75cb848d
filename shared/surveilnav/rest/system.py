"""The system itself: whether a mission could run, processes that are kept running, and traffic on the bus."""

from __future__ import annotations

from datetime import datetime
from typing import Literal

from pydantic import BaseModel, Field

from surveilnav.rest.base import Number, Resource, Text


class Readiness(BaseModel):
    """Whether a mission could run now."""

    ready: bool
    missing: list[str]
    checks: dict[str, str] = Field(description="per part: who is there, or what is missing and how to start it")


class Service(Resource):
    """A process that `surveilnav up` keeps running."""

    id: str
    running: bool = Field(description="false: it has ended, and waits for its next start or was given up")
    restarts: int = Field(description="how often it was started again")
    restarted: datetime | None = Field(description="when it was last started again")
    why: Text = Field(description="how it had ended: a signal or an exit code")
    given_up: bool = Field(description="it ended too often in a row, and isn't started any more")


class NodeTraffic(Resource):
    """Bytes and messages of a node since it started. ``wire_*``: the kernel's count on its own sockets."""

    id: str
    kind: str
    offered_bytes: int
    delivered_bytes: int
    offered_messages: int
    delivered_messages: int
    wire_sent_bytes: int | None
    wire_received_bytes: int | None
    simulation_bytes: int = Field(description="ground truth for simulated perception: no traffic of a real building")
    clock_offset_s: Number = Field(
        default=None,
        description="how far its clock is ahead of the gateway's, to about 0.1 s; null: unknown. Fusion doesn't believe the "
        "times of pictures whose clock is ahead by more than a second",
    )
    rejected: dict[str, int] = Field(description="what it dropped because it couldn't be read, by reason")
    unsent: dict[str, int] = Field(
        default={},
        description="how many frames it never sent because a newer picture came while they waited, by what they waited for: "
        "`budget` or `link`",
    )
    release: str = Field(default="", description="the version of SurveilNav that it runs; empty: it doesn't say")
    other_release: bool = Field(default=False, description="whether that isn't the gateway's own")
    problems: dict[str, str] = Field(
        default={}, description="what it can't do now, and why: `store`: it can't be written; empty if all is well"
    )


class SourceTraffic(Resource):
    """Bytes under the keys of a camera or robot: offered by it, delivered to all others."""

    id: str
    node: str
    offered_bytes: int
    delivered_bytes: int
    wire_sent_bytes: int | None
    frame_bytes: int
    frames: int
    tier_bytes: dict[str, int] = Field(default={}, description="frame_bytes of a camera by tier")
    replaced_bytes: int = Field(
        default=0, description="frames that arrived and were dropped unread: a newer one of their view came before"
    )
    missing_bytes: int = Field(
        default=0,
        description="frames that nobody has got: they are on their way, were dropped by a full link, or had no "
        "listener; right as long as neither side was started again",
    )
    viewer_bytes: int = Field(description="thumbnails for people, counted in offered_bytes too")
    by_stream: dict[str, int] = Field(description="offered bytes by stream of the contract")


class LinkTraffic(BaseModel):
    """Offered bytes by the link that they cross first. Together they are all that was offered."""

    camera_bytes: int = Field(default=0, description="by cameras, and by those who ask them: the building's network")
    robot_bytes: int = Field(default=0, description="by robots, and to them: mostly a wireless network")
    server_bytes: int = Field(default=0, description="by services to each other, and to people's programs")
    simulation_bytes: int = Field(
        default=0, description="by the simulator: no traffic of a real building, and in no other sum"
    )


TrafficStep = Literal["second", "minute"]


class TrafficPoint(LinkTraffic):
    """Offered bytes by link that were reported in one step of time."""

    at: datetime = Field(description="when the step began")


class TrafficOverTime(BaseModel):
    """Offered bytes over time: steps without any are left out. Nodes report within half a minute."""

    step_s: int
    points: list[TrafficPoint]


class Traffic(BaseModel):
    """Bytes offered, delivered and on the wire: in all, and by link, node, camera and robot.

    ``wire_sent_bytes`` is the sum over the nodes whose kernel counts it.
    """

    offered_bytes: int
    delivered_bytes: int
    wire_sent_bytes: int | None
    links: LinkTraffic = LinkTraffic()
    nodes: list[NodeTraffic]
    cameras: list[SourceTraffic]
    robots: list[SourceTraffic]

    def by_source(self) -> dict[str, BaseModel]:
        """The same in parts that change independently: "total" (without its lists), "camera/..." and "robot/..."."""
        total = self.model_copy(update={"nodes": [], "cameras": [], "robots": []})
        cameras = {f"camera/{s.id}": s for s in self.cameras}
        return {"total": total, **cameras, **{f"robot/{s.id}": s for s in self.robots}}
