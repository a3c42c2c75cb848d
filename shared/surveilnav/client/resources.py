"""What the gateway answers, as types: dictionaries, as JSON has them.

Generated from the OpenAPI document by `make docs`; don't edit.
"""

from __future__ import annotations

from typing import NotRequired, TypedDict


class Building(TypedDict):
    last_seen: str | None
    stale: bool
    id: str
    floors: list[str]
    cameras: int
    robots: int
    missions: int
    ready: bool


class Camera(TypedDict):
    last_seen: str | None
    stale: bool
    id: str
    floor: str
    position_m: list[float]
    mounting_offset_m: float | None
    hfov_rad: float
    width_px: int
    height_px: int
    tier: str
    paused: bool
    invoked: bool
    views_processed: int
    labels: dict[str, float | None]
    views: list[CameraView]


class CameraCone(TypedDict):
    view: int
    outline_m: list[list[float]]


class CameraLook(TypedDict):
    time: str
    client: str
    view: int
    what: str


class CameraView(TypedDict):
    view: int
    yaw_rad: float | None
    pitch_rad: float
    picture: str


class Event(TypedDict):
    id: str
    what: str
    time: str | None
    floor: NotRequired[str | None]
    target: NotRequired[str | None]
    label: NotRequired[str | None]
    robot: NotRequired[str | None]
    state: NotRequired[str | None]
    phase: NotRequired[str | None]
    step: NotRequired[int | None]
    found: NotRequired[bool | None]
    error: NotRequired[str | None]
    confidence: NotRequired[float | None]
    center_m: NotRequired[list[float | None] | None]
    restarts: NotRequired[int | None]
    message: NotRequired[str | None]


class Floor(TypedDict):
    last_seen: str | None
    stale: bool
    id: str
    z_m: float | None
    revision: int | None
    robots: list[str]
    cameras: list[str]
    invoked: list[FloorCamera]
    pending_views: int
    perception_ok: bool | None
    message: str
    layers: dict[str, str]


class FloorCamera(TypedDict):
    camera: str
    views_processed: int
    views: int


class Layer(TypedDict):
    floor: str
    layer: str
    target: str
    revision: int
    rows: int
    cols: int
    resolution_m: float
    T_world_cell: list[list[float]]
    low: float | None
    high: float | None
    views_left_out: int
    picture: str
    array: str


class Mission(TypedDict):
    last_seen: str | None
    stale: bool
    id: str
    target: str
    asked: str | None
    robot: str | None
    state: str
    phase: str
    step: int
    max_steps: int | None
    path_m: float | None
    distance_remaining_m: float | None
    time_remaining_s: float | None
    elapsed_s: float | None
    floor: str | None
    found: bool
    judged: bool | None
    object_id: int | None
    error: str | None
    message: str
    started: str | None
    finished: str | None
    floor_choice_bytes: int


class MissionPlan(TypedDict):
    last_seen: str | None
    stale: bool
    mission: str
    robot: str
    floor: str
    step: int
    action: str
    why: str
    waypoint: Place | None
    path_m: list[list[float | None]]
    candidates: list[Place]


class MissionTraffic(TypedDict):
    last_seen: str | None
    stale: bool
    mission: str
    offered_bytes: int
    delivered_bytes: int
    wire_sent_bytes: int
    alone: bool
    whole: bool
    per_step_bytes: float | None
    at_most_bytes: float | None


class NewMission(TypedDict):
    target: str
    robot: NotRequired[str | None]
    max_steps: NotRequired[int]
    queue: NotRequired[bool]


class NodeTraffic(TypedDict):
    last_seen: str | None
    stale: bool
    id: str
    kind: str
    offered_bytes: int
    delivered_bytes: int
    offered_messages: int
    delivered_messages: int
    wire_sent_bytes: int | None
    wire_received_bytes: int | None
    simulation_bytes: int
    rejected: dict[str, int]


class Object(TypedDict):
    last_seen: str | None
    stale: bool
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
    center_m: list[float | None]
    size_m: list[float | None]
    first_seen: str | None
    sources: list[str]
    relevance: float | None
    history: list[ObjectEvent]


class ObjectEvent(TypedDict):
    time: str | None
    source: str
    view: int
    seq: int
    label: str
    score: float | None
    what: str
    note: str
    box_px: list[float | None] | None


class PictureKeeper(TypedDict):
    keeper: str
    message: str


class Place(TypedDict):
    kind: str
    x_m: float | None
    y_m: float | None
    score: float | None
    chosen: bool
    note: str
    object_id: int | None


class Readiness(TypedDict):
    ready: bool
    missing: list[str]
    checks: dict[str, str]


class Recorder(TypedDict):
    last_seen: str | None
    stale: bool
    id: str
    recording: list[str]
    problem: str | None
    dropped: int
    n_bytes: int
    free_bytes: int


class Recording(TypedDict):
    id: str
    mission: str
    target: str
    state: str
    n_bytes: int
    started: str | None
    changed: str | None
    recorder: str
    cameras: list[str] | None
    file: str


class Replay(TypedDict):
    last_seen: str | None
    stale: bool
    mission: str
    target: str
    began: str | None
    at_s: float
    duration_s: float
    speed: float
    playing: bool
    jumps: int


class ReplayChange(TypedDict):
    at_s: NotRequired[float | None]
    speed: NotRequired[float | None]
    playing: NotRequired[bool | None]


class Robot(TypedDict):
    last_seen: str | None
    stale: bool
    id: str
    floor: str
    state: str
    seq: int
    position_m: list[float]
    yaw_rad: float
    mission: str | None
    message: str
    notes: list[str]


class RobotHalt(TypedDict):
    robot: str
    halted: bool | None
    stale: bool


class Service(TypedDict):
    last_seen: str | None
    stale: bool
    id: str
    running: bool
    restarts: int
    restarted: str | None
    why: str | None
    given_up: bool


class SourceTraffic(TypedDict):
    last_seen: str | None
    stale: bool
    id: str
    node: str
    offered_bytes: int
    delivered_bytes: int
    wire_sent_bytes: int | None
    frame_bytes: int
    frames: int
    viewer_bytes: int
    by_stream: dict[str, int]


class StageTimes(TypedDict):
    views: int
    p50_ms: float | None
    p95_ms: float | None


class Target(TypedDict):
    name: str
    workers: list[str]


class Traffic(TypedDict):
    offered_bytes: int
    delivered_bytes: int
    wire_sent_bytes: int | None
    nodes: list[NodeTraffic]
    cameras: list[SourceTraffic]
    robots: list[SourceTraffic]


class Worker(TypedDict):
    last_seen: str | None
    stale: bool
    id: str
    backend: str
    why: str
    queued: int
    capacity: int
    latency_ms: float | None
    calibrated: bool
    ready: bool
    cached: int
    models: dict[str, str]
    stages: dict[str, StageTimes]
