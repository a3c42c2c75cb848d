"""The resources of the REST interface, and how each is made from messages.

Every resource has ``last_seen`` (UTC, when this gateway last heard of it; null: never) and ``stale``: its owner
isn't there any more or, for what is put at a rate, it is older than the contract allows. Lengths are metres,
angles radians, positions in the world frame. Numbers that aren't finite become null: remote data can hold anything.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from services.gateway.core.traffic import SourceTraffic as SourceSums
from services.gateway.core.traffic import Traffic as Sums
from surveilnav import messages as m
from surveilnav.contract import ID_PATTERN
from surveilnav.geometry import yaw_of

FINISHED = ("done", "failed", "cancelled")
T = TypeVar("T")


class Resource(BaseModel):
    last_seen: datetime | None = Field(default=None, description="when the gateway last heard of it")
    stale: bool = Field(description="its owner is gone, or it is older than the contract allows")


class Items(BaseModel, Generic[T]):
    """A list: at most ``limit`` items from ``offset``; ``total`` says how many there are."""

    items: list[T]
    total: int


class NewMission(BaseModel):
    """Find ``target``."""

    model_config = ConfigDict(extra="forbid", str_strip_whitespace=True)

    target: str = Field(min_length=1, max_length=200, description="what to find: 'potted plant', 'couch', ...")
    robot: str | None = Field(default=None, pattern=ID_PATTERN, description="which robot; null: any free one")
    max_steps: int = Field(default=500, ge=1, le=100_000, description="give up after so many actions")


class Mission(Resource):
    id: str
    target: str
    robot: str | None
    state: str = Field(description="queued, active, confirming, done, failed or cancelled")
    phase: str = ""
    step: int = 0
    max_steps: int | None = None
    path_m: float | None = None
    distance_remaining_m: float | None = None
    floor: str | None = None
    found: bool = False
    object_id: int | None = None
    error: str | None = Field(default=None, description="the name of the failure")
    message: str = ""
    started: datetime | None = None
    finished: datetime | None = None
    floor_choice_bytes: int = Field(
        default=0, description="what the cameras' summaries cost, by which the floor is chosen"
    )


class Place(BaseModel):
    """Something that the planner weighed."""

    kind: str
    x_m: float | None
    y_m: float | None
    score: float | None
    chosen: bool
    note: str
    object_id: int | None


class MissionPlan(Resource):
    mission: str
    robot: str
    floor: str
    step: int
    action: str
    waypoint: Place | None
    path_m: list[tuple[float | None, float | None]]
    candidates: list[Place]


class CameraView(BaseModel):
    view: int
    yaw_rad: float | None = Field(
        description="azimuth of the optical axis, anticlockwise from +x; null: looks straight down"
    )
    pitch_rad: float
    picture: str = Field(description="where a thumbnail is; each request costs the camera one view of traffic")


class Camera(Resource):
    id: str
    floor: str
    position_m: tuple[float, float, float]
    mounting_offset_m: float | None
    hfov_rad: float
    width_px: int
    height_px: int
    tier: str
    invoked: bool = Field(description="the maps of its floor subscribe to it")
    views_held: int = Field(default=0, description="how many of its views the maps hold")
    labels: dict[str, float | None] = Field(default_factory=dict, description="what it last saw, with confidences")
    views: list[CameraView]


class Robot(Resource):
    id: str
    floor: str
    state: str
    seq: int
    position_m: tuple[float, float, float]
    yaw_rad: float
    mission: str | None
    message: str


class FloorCamera(BaseModel):
    camera: str
    views_held: int
    views: int


class Floor(Resource):
    id: str
    z_m: float | None
    revision: int | None = Field(description="null: nobody has mapped it yet")
    robots: list[str]
    cameras: list[str]
    invoked: list[FloorCamera]
    pending_views: int = 0
    perception_ok: bool | None = None
    message: str = ""
    layers: dict[str, str] = Field(description="where the pictures are")


class ObjectEvent(BaseModel):
    time: datetime | None
    source: str
    view: int
    seq: int
    label: str
    score: float | None
    what: str
    note: str
    box_px: list[float | None] | None


class Object(Resource):
    id: int
    floor: str
    label: str
    status: str
    reason: str
    confidence: float | None
    confidence_robot: float | None
    confidence_surveillance: float | None
    label_robot: str
    label_surveillance: str
    n_detections: int
    n_points: int
    center_m: tuple[float | None, float | None, float | None]
    size_m: tuple[float | None, float | None, float | None]
    first_seen: datetime | None
    sources: list[str]
    history: list[ObjectEvent]


class Worker(Resource):
    id: str
    backend: str
    why: str
    queued: int
    capacity: int
    latency_ms: float | None


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


class Traffic(BaseModel):
    """The three numbers, in all and by node, camera and robot. ``wire_sent_bytes``: sum over the nodes known."""

    offered_bytes: int
    delivered_bytes: int
    wire_sent_bytes: int | None
    nodes: list[NodeTraffic]
    cameras: list[SourceTraffic]
    robots: list[SourceTraffic]


class Readiness(BaseModel):
    ready: bool
    missing: list[str]
    checks: dict[str, str] = Field(description="per part: who is there, or what is missing and how to start it")


def finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def when(stamp_ns: int | None) -> datetime | None:
    """UTC; None for 0 and for stamps that are no time of ours."""
    if not stamp_ns:
        return None
    try:
        return datetime.fromtimestamp(stamp_ns / 1e9, UTC)
    except (OverflowError, ValueError, OSError):
        return None


def mission(status: m.MissionStatus, seen_ns: int, planner_alive: bool) -> Mission:
    return Mission(
        id=status.mission,
        target=status.target,
        robot=status.robot or None,
        state=status.state,
        phase=status.phase,
        step=status.step,
        max_steps=status.max_steps,
        path_m=finite(status.path_m),
        distance_remaining_m=finite(status.distance_remaining_m),
        floor=status.floor or None,
        found=status.found,
        object_id=status.object_id,
        error=status.error or None,
        message=status.message,
        started=when(status.started_ns),
        finished=when(status.finished_ns),
        floor_choice_bytes=status.floor_choice_bytes,
        last_seen=when(seen_ns),
        stale=status.state not in FINISHED and not planner_alive,  # what is finished stays true without its planner
    )


def mission_from_ack(ack: m.MissionAck, goal: NewMission, seen_ns: int) -> Mission:
    """A mission just accepted, of which no status was heard yet."""
    return Mission(
        id=ack.mission,
        target=goal.target,
        robot=ack.robot or goal.robot,
        state=ack.state,
        max_steps=goal.max_steps,
        message=ack.message,
        last_seen=when(seen_ns),
        stale=False,
    )


def _place(candidate: m.Candidate) -> Place:
    return Place(
        kind=candidate.kind,
        x_m=finite(candidate.x_m),
        y_m=finite(candidate.y_m),
        score=finite(candidate.score),
        chosen=candidate.chosen,
        note=candidate.note,
        object_id=candidate.object_id,
    )


def plan(message: m.Plan, seen_ns: int, planner_alive: bool) -> MissionPlan:
    return MissionPlan(
        mission=message.mission,
        robot=message.robot,
        floor=message.floor,
        step=message.step,
        action=message.action,
        waypoint=_place(message.waypoint) if message.waypoint else None,
        path_m=[(finite(x), finite(y)) for x, y in message.path_m],
        candidates=[_place(c) for c in message.candidates],
        last_seen=when(seen_ns),
        stale=not planner_alive,
    )


def camera(
    info: m.CameraInfo, use: m.CameraUse | None, labels: dict[str, float], seen_ns: int, alive: bool, root: str
) -> Camera:
    """``root`` is the address below which cameras lie."""
    views = []
    for view in info.views:
        axis = view.T_world_camera.matrix()[:3, 2]
        level = math.hypot(axis[0], axis[1])
        views.append(
            CameraView(
                view=view.view,
                yaw_rad=math.atan2(axis[1], axis[0]) if level > 1e-3 else None,
                pitch_rad=math.atan2(axis[2], level),
                picture=f"{root}/cameras/{info.camera}/views/{view.view}.jpg",
            )
        )
    x, y, z = (finite(v) or 0.0 for v in info.position_m)
    return Camera(
        id=info.camera,
        floor=info.floor,
        position_m=(x, y, z),
        mounting_offset_m=finite(info.mounting_offset_m),
        hfov_rad=info.intrinsics.hfov_rad,
        width_px=info.intrinsics.width_px,
        height_px=info.intrinsics.height_px,
        tier=info.tier,
        invoked=use is not None,
        views_held=use.views_held if use else 0,
        labels={k: finite(v) for k, v in labels.items()},
        views=views,
        last_seen=when(seen_ns),
        stale=not alive,
    )


def robot(status: m.RobotStatus, mission_id: str | None, seen_ns: int, stale: bool) -> Robot:
    return Robot(
        id=status.robot,
        floor=status.floor,
        state=status.state,
        seq=status.seq,
        mission=mission_id,
        position_m=status.T_world_base.translation_m,
        yaw_rad=yaw_of(status.T_world_base.matrix()),
        message=status.message,
        last_seen=when(seen_ns),
        stale=stale,
    )


def floor(
    id: str,
    revision: m.Revision | None,
    robots: list[str],
    cameras: list[str],
    seen_ns: int | None,
    alive: bool,
    root: str,
) -> Floor:
    """``robots`` and ``cameras`` say that they are there; the revision may not exist yet."""
    invoked = (
        [FloorCamera(camera=u.camera, views_held=u.views_held, views=u.views) for u in revision.cameras]
        if revision
        else []
    )
    return Floor(
        id=id,
        z_m=finite(revision.floor_z_m) if revision else None,
        revision=revision.revision if revision else None,
        robots=robots,
        cameras=cameras,
        invoked=invoked,
        pending_views=revision.pending_views if revision else 0,
        perception_ok=revision.perception_ok if revision else None,
        message=revision.message if revision else "",
        layers={
            name: f"{root}/floors/{id}/layers/{name}.png" for name in ("occupancy", "explored", "frontier", "value")
        },
        last_seen=when(seen_ns),
        stale=not alive,
    )


def object_(record: m.ObjectRecord) -> Object:
    x, y, z = (finite(v) for v in record.center_m)
    dx, dy, dz = (finite(v) for v in record.size_m)
    return Object(
        id=record.id,
        floor=record.floor,
        label=record.label,
        status=record.status,
        reason=record.reason,
        confidence=finite(record.confidence),
        confidence_robot=finite(record.confidence_robot),
        confidence_surveillance=finite(record.confidence_surveillance),
        label_robot=record.label_robot,
        label_surveillance=record.label_surveillance,
        n_detections=record.n_detections,
        n_points=record.n_points,
        center_m=(x, y, z),
        size_m=(dx, dy, dz),
        first_seen=when(record.first_seen_ns),
        sources=record.sources,
        history=[
            ObjectEvent(
                time=when(e.stamp_ns),
                source=e.source,
                view=e.view,
                seq=e.seq,
                label=e.label,
                score=finite(e.score),
                what=e.what,
                note=e.note,
                box_px=[finite(v) for v in e.box_px] if e.box_px else None,
            )
            for e in record.history
        ],
        last_seen=when(record.last_seen_ns),
        stale=False,
    )


def worker(load: m.WorkerLoad, seen_ns: int, stale: bool) -> Worker:
    return Worker(
        id=load.worker,
        backend=load.backend,
        why=load.why,
        queued=load.queued,
        capacity=load.capacity,
        latency_ms=finite(load.latency_ms),
        last_seen=when(seen_ns),
        stale=stale,
    )


def traffic(sums: Sums, heard: dict[str, tuple[int, bool]]) -> Traffic:
    """``heard``: by "kind/node", when a report last came (ns) and whether that is too long ago."""

    def source(s: SourceSums) -> SourceTraffic:
        seen_ns, stale = heard.get(s.node, (0, True))
        return SourceTraffic(**asdict(s), last_seen=when(seen_ns), stale=stale)

    nodes = []
    for n in sums.nodes:
        facts = asdict(n)
        seen_ns, stale = heard.get(f"{n.kind}/{n.node}", (0, True))
        nodes.append(NodeTraffic(id=facts.pop("node"), **facts, last_seen=when(seen_ns), stale=stale))
    return Traffic(
        offered_bytes=sums.offered_bytes,
        delivered_bytes=sums.delivered_bytes,
        wire_sent_bytes=sums.wire_sent_bytes,
        nodes=nodes,
        cameras=[source(s) for s in sums.cameras],
        robots=[source(s) for s in sums.robots],
    )


#: What must be there before a mission makes sense, and how to start it.
NEEDED: tuple[tuple[Literal["robot", "perception", "fusion", "planner"], str], ...] = (
    ("robot", "python -m services.robot_node"),
    ("perception", "python -m services.perception"),
    ("fusion", "python -m services.fusion"),
    ("planner", "python -m services.planner"),
)


def readiness(routers: int, alive: dict[str, set[str]]) -> Readiness:
    """Whether a mission could run now: a session to a router, and one living node of each kind needed."""
    checks = {"router": "connected" if routers else "missing: no session to the router; start it with `surveilnav up`"}
    for kind, command in NEEDED:
        ids = sorted(alive.get(kind, set()))
        checks[kind] = ", ".join(ids) if ids else f"missing: none has announced itself; start one with `{command}`"
    missing = [name for name, found in checks.items() if found.startswith("missing: ")]
    return Readiness(ready=not missing, missing=missing, checks=checks)
