"""Bytes offered, delivered and on the wire."""

from __future__ import annotations

from pydantic import BaseModel, Field

from surveilnav.messages import MissionStatus
from surveilnav.services.gateway.core import traffic as sums
from surveilnav.services.gateway.core.costs import Cost
from surveilnav.services.gateway.core.resources.base import Number, Resource


class NodeTraffic(Resource):
    """Bytes and messages of a node since it started. ``wire_*``: the kernel's count on its own sockets."""

    id: str = Field(validation_alias="node")
    kind: str
    offered_bytes: int
    delivered_bytes: int
    offered_messages: int
    delivered_messages: int
    wire_sent_bytes: int | None
    wire_received_bytes: int | None
    simulation_bytes: int = Field(description="ground truth for simulated perception: no traffic of a real building")
    rejected: dict[str, int] = Field(description="what it dropped because it couldn't be read")


class SourceTraffic(Resource):
    """Bytes under the keys of a camera or robot: offered by it, delivered to all others."""

    id: str
    node: str
    offered_bytes: int
    delivered_bytes: int
    wire_sent_bytes: int | None
    frame_bytes: int
    frames: int
    viewer_bytes: int = Field(description="thumbnails for people, counted in offered_bytes too")
    by_stream: dict[str, int] = Field(description="offered bytes by stream of the contract")


class MissionTraffic(Resource):
    """What cameras and robots sent while a mission ran, and what it may come to. Pictures for people aren't counted."""

    mission: str
    offered_bytes: int
    delivered_bytes: int
    wire_sent_bytes: int
    alone: bool = Field(description="false: other missions ran meanwhile, and nobody can tell what was for which")
    whole: bool = Field(description="false: the gateway came later than the mission")
    per_step_bytes: Number = Field(description="offered a step, mean of the newest 20 steps; null before that")
    at_most_bytes: Number = Field(description="offered in the end, if it goes on like this and uses all its steps")

    @classmethod
    def of(cls, cost: Cost, status: MissionStatus, seen_ns: int) -> MissionTraffic:
        """What a mission has cost so far."""
        spent = cost.spent
        return cls(
            mission=cost.mission,
            offered_bytes=spent.offered,
            delivered_bytes=spent.delivered,
            wire_sent_bytes=spent.wire,
            alone=cost.alone,
            whole=cost.whole,
            per_step_bytes=cost.per_step,
            at_most_bytes=cost.at_most(status),
            last_seen=seen_ns,
            stale=False,
        )


class Traffic(BaseModel):
    """The three numbers, in all and by node, camera and robot. ``wire_sent_bytes``: sum over the nodes known."""

    offered_bytes: int
    delivered_bytes: int
    wire_sent_bytes: int | None
    nodes: list[NodeTraffic]
    cameras: list[SourceTraffic]
    robots: list[SourceTraffic]

    def by_source(self) -> dict[str, BaseModel]:
        """The sums apart: "total", "camera/..." and "robot/..."."""
        total = self.model_copy(update={"nodes": [], "cameras": [], "robots": []})
        cameras = {f"camera/{s.id}": s for s in self.cameras}
        return {"total": total, **cameras, **{f"robot/{s.id}": s for s in self.robots}}

    @classmethod
    def from_sums(cls, total: sums.Traffic, heard: dict[str, tuple[int, bool]]) -> Traffic:
        """``heard``: by "kind/node", when a report last came (ns) and whether that is too long ago."""

        def age(node: str) -> dict[str, object]:
            """When a node's report last came, and whether that is too long ago."""
            seen_ns, stale = heard.get(node, (0, True))
            return {"last_seen": seen_ns, "stale": stale}

        return cls(
            offered_bytes=total.offered_bytes,
            delivered_bytes=total.delivered_bytes,
            wire_sent_bytes=total.wire_sent_bytes,
            nodes=[NodeTraffic.made_of(n, **age(f"{n.kind}/{n.node}")) for n in total.nodes],
            cameras=[SourceTraffic.made_of(s, **age(s.node)) for s in total.cameras],
            robots=[SourceTraffic.made_of(s, **age(s.node)) for s in total.robots],
        )
