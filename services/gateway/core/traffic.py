"""Sums over what every node counted: bytes offered, delivered and on the wire, per node, camera and robot.

Offered is what a node put or asked (payload + attachment + key), delivered is what a node got, and wire is the kernel's
count on a node's own sockets. ``delivered`` of a camera or robot is what the other nodes got under its keys. Ground truth for
the simulated backends isn't traffic of a real building, and is counted apart.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import NamedTuple, get_args

import surveilnav
from surveilnav import contract
from surveilnav.messages import Tier, TrafficReport, WaitReason
from surveilnav.rest import LinkTraffic, NodeTraffic, SourceTraffic, Traffic
from surveilnav.services.gateway.core.resources import utc
from surveilnav.services.gateway.core.traffic_series import LINKS

_CAMERA_STREAMS = [s for s in contract.STREAMS if "camera" in s.fields]
#: Each has one reader that counts, so that what was offered and what arrived can be compared.
_FRAMES = (contract.CAMERA_FRAME.name, contract.ROBOT_OBSERVATION.name)
_ROBOT_STREAMS = [s for s in contract.STREAMS if "robot" in s.fields]


class ReportAge(NamedTuple):
    """When a node's newest report arrived [ns since the epoch], and whether that is too long ago."""

    seen_ns: int = 0
    stale: bool = True


class _Row(NamedTuple):
    stream: str
    direction: str
    n_bytes: int
    messages: int


def sum_traffic(reports: Iterable[TrafficReport], received: Mapping[str, ReportAge] | None = None) -> Traffic:
    """The sums by node, camera and robot, each sorted by name. ``received`` says by "kind/node" when reports arrived."""
    newest = {f"{r.kind}/{r.node}": r for r in sorted(reports, key=lambda r: r.stamp_ns)}
    ordered = sorted(newest.values(), key=lambda r: (r.kind, r.node))
    received = received or {}
    nodes = [_node(r, received.get(f"{r.kind}/{r.node}", ReportAge())) for r in ordered]
    wire = [n.wire_sent_bytes for n in nodes if n.wire_sent_bytes is not None]
    return Traffic(
        offered_bytes=sum(n.offered_bytes for n in nodes),
        delivered_bytes=sum(n.delivered_bytes for n in nodes),
        wire_sent_bytes=sum(wire) if wire else None,
        links=_links(ordered),
        nodes=nodes,
        cameras=_sources(ordered, "camera", received),
        robots=_sources(ordered, "robot", received),
    )


def links_by_node(reports: Iterable[TrafficReport]) -> dict[str, tuple[int, ...]]:
    """By "kind/node", what it has offered over each link, in the order of ``LINKS``."""
    found = {}
    for report in reports:
        n_bytes = dict.fromkeys(LINKS, 0)
        for row in report.rows:
            if row.direction == "offered":
                n_bytes[link_of(report.kind, row.key)] += row.n_bytes
        found[f"{report.kind}/{report.node}"] = tuple(n_bytes.values())
    return found


def _links(reports: Iterable[TrafficReport]) -> LinkTraffic:
    sums = [sum(column) for column in zip(*links_by_node(reports).values(), strict=True)] or [0] * len(LINKS)
    return LinkTraffic(**{f"{link}_bytes": n for link, n in zip(LINKS, sums, strict=True)})


def link_of(kind: str, key: str) -> str:
    """The link that what a node of this kind offers under a key crosses first: camera, robot, server or simulation."""
    if _is_simulation(key):
        return "simulation"
    for end in ("camera", "robot"):
        if kind == end or _owner_and_stream(key, end):
            return end
    return "server"


def _node(report: TrafficReport, received: ReportAge) -> NodeTraffic:
    real = [r for r in report.rows if not _is_simulation(r.key)]
    offered = [r for r in real if r.direction == "offered"]
    delivered = [r for r in real if r.direction == "delivered"]
    return NodeTraffic(
        id=report.node,
        kind=report.kind,
        offered_bytes=sum(r.n_bytes for r in offered),
        delivered_bytes=sum(r.n_bytes for r in delivered),
        offered_messages=sum(r.messages for r in offered),
        delivered_messages=sum(r.messages for r in delivered),
        wire_sent_bytes=report.wire_sent_bytes,
        wire_received_bytes=report.wire_received_bytes,
        simulation_bytes=sum(r.n_bytes for r in report.rows) - sum(r.n_bytes for r in real),
        clock_offset_s=(report.stamp_ns - received.seen_ns) / 1e9 if received.seen_ns else None,
        rejected=report.rejected,
        unsent={reason: n for reason, n in report.unsent.items() if reason in get_args(WaitReason)},
        release=report.release,
        other_release=report.release != surveilnav.__version__,
        problems=report.problems,
        last_seen=utc(received.seen_ns),
        stale=received.stale,
    )


@lru_cache(maxsize=50_000)
def _is_simulation(key: str) -> bool:
    return any(stream.ids_of(key) for stream in contract.SIMULATION)


@lru_cache(maxsize=50_000)
def _owner_and_stream(key: str, kind: str) -> tuple[str, str] | None:
    """(id, stream) of a key that belongs to a camera or robot."""
    for stream in _CAMERA_STREAMS if kind == "camera" else _ROBOT_STREAMS:
        if ids := stream.ids_of(key):
            return ids[kind], stream.name
    return None


def _sources(reports: list[TrafficReport], kind: str, received: Mapping[str, ReportAge]) -> list[SourceTraffic]:
    #: id -> node -> rows
    rows: dict[str, dict[str, list[_Row]]] = defaultdict(lambda: defaultdict(list))
    by_name = {f"{r.kind}/{r.node}": r for r in reports}
    for report in reports:
        for row in report.rows:
            if found := _owner_and_stream(row.key, kind):
                rows[found[0]][f"{report.kind}/{report.node}"].append(
                    _Row(found[1], row.direction, row.n_bytes, row.messages)
                )
    return [_source(kind, id, rows[id], by_name, received) for id in sorted(rows)]


def _source(
    kind: str,
    id: str,
    by_node: dict[str, list[_Row]],
    reports: Mapping[str, TrafficReport],
    received: Mapping[str, ReportAge],
) -> SourceTraffic:
    node = _sender(f"{kind}/{id}", by_node)
    offered = [row for row in by_node.get(node, ()) if row.direction == "offered"]
    delivered = [row for name, rows in by_node.items() if name != node for row in rows if row.direction == "delivered"]
    frames = [r for r in offered if r.stream in _FRAMES]
    arrived = {
        direction: sum(
            r.n_bytes
            for name, rows in by_node.items()
            for r in rows
            if name != node and r.stream in _FRAMES and r.direction == direction
        )
        for direction in ("delivered", "replaced")
    }
    by_stream: dict[str, int] = defaultdict(int)
    for row in offered:
        by_stream[row.stream] += row.n_bytes
    seen_ns, stale = received.get(node, ReportAge())
    report = reports.get(node)
    return SourceTraffic(
        id=id,
        node=node,
        offered_bytes=sum(r.n_bytes for r in offered),
        delivered_bytes=sum(r.n_bytes for r in delivered),
        wire_sent_bytes=report.wire_sent_bytes if report else None,
        frame_bytes=(frame_bytes := sum(r.n_bytes for r in frames)),
        tier_bytes={tier: n for tier, n in report.tier_bytes.items() if tier in get_args(Tier)} if report else {},
        replaced_bytes=arrived["replaced"],
        missing_bytes=max(0, frame_bytes - sum(arrived.values())),
        frames=sum(r.messages for r in frames),
        viewer_bytes=by_stream.get(contract.CAMERA_REQUEST.name, 0),
        by_stream=dict(by_stream),
        last_seen=utc(seen_ns),
        stale=stale,
    )


def _sender(name: str, by_node: dict[str, list[_Row]]) -> str:
    """The node that sends under the keys of ``name``: the one of that name, else the one that offered most; "" if none did."""

    def offered(node: str) -> int:
        """How many bytes a node put under these keys."""
        return sum(row.n_bytes for row in by_node[node] if row.direction == "offered")

    node = name if name in by_node else max(sorted(by_node), key=offered)  # others only ask under its keys
    return node if offered(node) else ""
