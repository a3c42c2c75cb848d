"""Sums over what every node counted: offered, delivered and wire, per node, camera and robot.

Offered is what a node put or asked (payload + attachment + key), delivered what a node got, wire the kernel's
count on a node's own sockets. For a camera or robot, ``delivered`` counts what the others got under its keys.
Ground truth for the simulated backends isn't traffic of a real building: it is summed apart.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache

from surveilnav import contract
from surveilnav.messages import TrafficReport

_OF_CAMERA = [s for s in contract.STREAMS if "camera" in s.fields]
_OF_ROBOT = [s for s in contract.STREAMS if "robot" in s.fields]


@dataclass(frozen=True, slots=True)
class NodeTraffic:
    """Bytes and messages of one node since it started. ``wire_*``: None where the kernel doesn't tell."""

    node: str
    kind: str
    offered_bytes: int
    delivered_bytes: int
    offered_messages: int
    delivered_messages: int
    wire_sent_bytes: int | None
    wire_received_bytes: int | None
    simulation_bytes: int
    rejected: dict[str, int]


@dataclass(slots=True)
class SourceTraffic:
    """Bytes under the keys of one camera or robot. ``node`` is the one that sends them."""

    id: str
    node: str = ""
    offered_bytes: int = 0
    delivered_bytes: int = 0
    wire_sent_bytes: int | None = None
    frame_bytes: int = 0
    frames: int = 0
    viewer_bytes: int = 0
    by_stream: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Traffic:
    nodes: list[NodeTraffic]
    cameras: list[SourceTraffic]
    robots: list[SourceTraffic]

    @property
    def offered_bytes(self) -> int:
        """Sum over the nodes."""
        return sum(n.offered_bytes for n in self.nodes)

    @property
    def delivered_bytes(self) -> int:
        """Sum over the nodes."""
        return sum(n.delivered_bytes for n in self.nodes)

    @property
    def wire_sent_bytes(self) -> int | None:
        """Sum over the nodes whose kernel tells; None if none does."""
        known = [n.wire_sent_bytes for n in self.nodes if n.wire_sent_bytes is not None]
        return sum(known) if known else None


def sum_traffic(reports: Iterable[TrafficReport]) -> Traffic:
    """The table of all nodes, cameras and robots, each sorted by name."""
    newest = {(r.kind, r.node): r for r in sorted(reports, key=lambda r: r.stamp_ns)}
    ordered = [newest[key] for key in sorted(newest)]
    return Traffic(
        [_node(r) for r in ordered], _sources(ordered, _OF_CAMERA, "camera"), _sources(ordered, _OF_ROBOT, "robot")
    )


def _node(report: TrafficReport) -> NodeTraffic:
    real = [r for r in report.rows if not _is_simulation(r.key)]
    offered = [r for r in real if r.direction == "offered"]
    delivered = [r for r in real if r.direction == "delivered"]
    return NodeTraffic(
        report.node,
        report.kind,
        sum(r.n_bytes for r in offered),
        sum(r.n_bytes for r in delivered),
        sum(r.messages for r in offered),
        sum(r.messages for r in delivered),
        report.wire_sent_bytes,
        report.wire_received_bytes,
        sum(r.n_bytes for r in report.rows) - sum(r.n_bytes for r in real),
        report.rejected,
    )


@lru_cache(maxsize=50_000)
def _is_simulation(key: str) -> bool:
    return any(stream.ids_of(key) for stream in contract.SIMULATION)


@lru_cache(maxsize=50_000)
def _place(key: str, kind: str) -> tuple[str, str] | None:
    """(id, stream) of a key that belongs to a camera or robot."""
    for stream in _OF_CAMERA if kind == "camera" else _OF_ROBOT:
        if ids := stream.ids_of(key):
            return ids[kind], stream.name
    return None


def _sources(reports: list[TrafficReport], streams: list[contract.Stream], kind: str) -> list[SourceTraffic]:
    #: id -> node -> [(stream, direction, bytes, messages)]
    rows: dict[str, dict[str, list[tuple[str, str, int, int]]]] = defaultdict(lambda: defaultdict(list))
    wire = {f"{r.kind}/{r.node}": r.wire_sent_bytes for r in reports}
    for report in reports:
        for row in report.rows:
            if found := _place(row.key, kind):
                rows[found[0]][f"{report.kind}/{report.node}"].append(
                    (found[1], row.direction, row.n_bytes, row.messages)
                )
    return [_source(kind, id, rows[id], wire) for id in sorted(rows)]


def _source(
    kind: str, id: str, by_node: dict[str, list[tuple[str, str, int, int]]], wire: dict[str, int | None]
) -> SourceTraffic:
    def offered(node: str) -> int:
        """Bytes that a node put under these keys."""
        return sum(n for _, direction, n, _ in by_node[node] if direction == "offered")

    by_name = f"{kind}/{id}"
    owner = by_name if by_name in by_node else max(sorted(by_node), key=offered)  # others only ask under its keys
    if not offered(owner):
        owner = ""
    source = SourceTraffic(id, node=owner, wire_sent_bytes=wire.get(owner))
    for node, rows in by_node.items():
        for stream, direction, n_bytes, messages in rows:
            if direction == "delivered" and node != owner:
                source.delivered_bytes += n_bytes
            elif direction == "offered" and node == owner:
                source.offered_bytes += n_bytes
                source.by_stream[stream] = source.by_stream.get(stream, 0) + n_bytes
                if stream in (contract.CAMERA_FRAME.name, contract.ROBOT_OBSERVATION.name):
                    source.frame_bytes += n_bytes
                    source.frames += messages
                elif stream == contract.CAMERA_REQUEST.name:
                    source.viewer_bytes += n_bytes
    return source
