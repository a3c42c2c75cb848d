"""Resources of the REST interface from messages of the bus. Pure: what depends on other messages or on time is passed in.

Arguments that recur: ``seen_ns`` is when the message arrived [ns since the epoch], ``stale`` says that its owner is gone or
that it is too old, and ``root`` is what addresses in answers begin with.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from functools import lru_cache
from typing import Any, Literal, TypeVar
from urllib.parse import quote

import msgspec
from pydantic import BaseModel

from surveilnav import messages as m
from surveilnav.geometry import Pose, yaw_of
from surveilnav.histogram import quantile_ms
from surveilnav.rest import (
    ROOT,
    Building,
    Camera,
    CameraStream,
    CameraView,
    Floor,
    Layer,
    Mission,
    Object,
    Readiness,
    Recorder,
    Recording,
    Replay,
    Resource,
    Robot,
    Service,
    StageTimes,
    Worker,
)
from surveilnav.rest.base import finite
from surveilnav.sensing.layers import GRID_LAYERS
from surveilnav.services.gateway.core.layers import RenderedLayer, transform

R = TypeVar("R", bound=BaseModel)
_MAX_REASON_CHARS = 300
#: Longer, since it says what to do.
_MAX_WHY_CHARS = 1000
#: What must be there before a mission makes sense, and how to start it.
NEEDED: tuple[tuple[Literal["robot", "perception", "fusion", "planner"], str], ...] = (
    ("robot", "python -m surveilnav.services.robot_node"),
    ("perception", "python -m surveilnav.services.perception"),
    ("fusion", "python -m surveilnav.services.fusion"),
    ("planner", "python -m surveilnav.services.planner"),
)


def utc(stamp_ns: int | None) -> datetime | None:
    """The time of a stamp [ns since the epoch]; None for 0, and for stamps outside the range of dates."""
    if not stamp_ns:
        return None
    try:
        return datetime.fromtimestamp(stamp_ns / 1e9, UTC)
    except (OverflowError, ValueError, OSError):
        return None


def resource_from(model: type[R], message: Any, **fields: object) -> R:
    """A resource with the fields of ``message`` (a struct or a dataclass) that have the same name, and with ``fields``."""
    known = msgspec.structs.asdict(message) if isinstance(message, msgspec.Struct) else asdict(message)
    return model.model_validate(known | fields, from_attributes=True)


# --- cameras ------------------------------------------------------------------------------------------------------


def camera_from_info(
    info: m.CameraInfo,
    use: m.CameraUse | None,
    labels: dict[str, float],
    seen_ns: int,
    alive: bool,
    root: str = ROOT,
) -> Camera:
    """A camera as it announced itself. ``use`` is what fusion has processed of it, ``labels`` its newest summary."""
    return resource_from(
        Camera,
        info,
        id=info.camera,
        position_m=tuple(finite(v) or 0.0 for v in info.position_m),
        hfov_rad=info.intrinsics.hfov_rad,
        width_px=info.intrinsics.width_px,
        height_px=info.intrinsics.height_px,
        invoked=use is not None,
        views_processed=use.views_processed if use else 0,
        quarantine=use.quarantine[:_MAX_REASON_CHARS] if use else "",
        labels=labels,
        views=[_view(info.camera, view, root) for view in info.views],
        stream=CameraStream(
            state=info.stream.state,
            reason=info.stream.reason[:_MAX_REASON_CHARS],
            since=utc(info.stream.since_ns),
            n_bytes=info.stream.n_bytes,
        ),
        last_seen=utc(seen_ns),
        stale=not alive,
    )


def _view(camera: str, info: m.CameraViewInfo, root: str) -> CameraView:
    axis = _optical_axis(info.T_world_camera)
    horizontal = math.hypot(axis[0], axis[1])
    return CameraView(
        view=info.view,
        yaw_rad=math.atan2(axis[1], axis[0]) if horizontal > 1e-3 else None,
        pitch_rad=math.atan2(axis[2], horizontal),
        picture=f"{root}/cameras/{camera}/views/{info.view}.jpg",
    )


@lru_cache(maxsize=50_000)  # every client asks for every camera
def _optical_axis(T_world_camera: Pose) -> tuple[float, float, float]:
    x, y, z = T_world_camera.matrix()[:3, 2].tolist()
    return x, y, z


# --- the building and its maps ------------------------------------------------------------------------------------


def building_from_parts(
    id: str,
    floors: Sequence[Floor],
    cameras: Sequence[Camera],
    robots: Sequence[Robot],
    missions: Sequence[Mission],
    *,
    ready: bool,
) -> Building:
    """A building by what is in it; stale if everything in it is."""
    parts: list[Resource] = [*floors, *cameras, *robots]
    return Building(
        id=id,
        floors=[f.id for f in floors],
        cameras=len(cameras),
        robots=len(robots),
        missions=sum(not mission.has_ended for mission in missions),
        ready=ready,
        last_seen=max((part.last_seen for part in parts if part.last_seen), default=None),
        stale=all(part.stale for part in parts),
    )


def floor_from_revision(
    id: str,
    revision: m.Revision | None,
    robots: Sequence[str],
    cameras: Sequence[str],
    seen_ns: int | None,
    alive: bool,
    root: str = ROOT,
) -> Floor:
    """A floor with the robots and cameras that say they are on it. ``revision`` is None where it has no map yet."""
    mapped = msgspec.structs.asdict(revision) if revision else {"floor_z_m": None, "revision": None, "cameras": []}
    fields = {
        "id": id,
        "z_m": mapped["floor_z_m"],
        "robots": robots,
        "cameras": cameras,
        "invoked": mapped["cameras"],
        "layers": {name: f"{root}/floors/{id}/layers/{name}.png" for name in GRID_LAYERS},
        "last_seen": utc(seen_ns),
        "stale": not alive,
    }
    return Floor.model_validate(mapped | fields, from_attributes=True)


def layer_from_array(
    floor: str, layer: str, target: str, array: RenderedLayer, revision: int, root: str = ROOT
) -> Layer:
    """Where a layer lies in the world, by its array."""
    address = f"{root}/floors/{floor}/layers/{layer}"
    query = f"?target={quote(target)}" if target else ""
    return Layer(
        floor=floor,
        layer=layer,
        target=target,
        revision=revision,
        rows=array.grid.rows,
        cols=array.grid.cols,
        resolution_m=array.grid.resolution_m,
        T_world_cell=transform(array.grid),
        low=array.low,
        high=array.high,
        views_left_out=array.views_left_out,
        picture=f"{address}.png{query}",
        array=f"{address}.npy{query}",
    )


def object_from_record(record: m.ObjectRecord) -> Object:
    """An object as fusion reports it. It was asked for a moment ago, so it is never stale."""
    history = [msgspec.structs.asdict(event) | {"time": utc(event.stamp_ns)} for event in record.history]
    return resource_from(
        Object,
        record,
        first_seen=utc(record.first_seen_ns),
        history=history,
        last_seen=utc(record.last_seen_ns),
        stale=False,
    )


# --- robots and workers -------------------------------------------------------------------------------------------


def robot_from_status(
    status: m.RobotStatus,
    mission: str | None,
    seen_ns: int,
    stale: bool,
    frame: m.RobotFrameProblem | None = None,
) -> Robot:
    """A robot as it reports itself, and the mission under way that it is on. ``frame``: fusion says that it isn't there."""
    pose = status.T_world_base
    return resource_from(
        Robot,
        status,
        id=status.robot,
        position_m=pose.translation_m,
        yaw_rad=yaw_of(pose.matrix()),
        mission=mission,
        frame_problem=frame.message[:_MAX_WHY_CHARS] if frame else "",
        frame_correction=msgspec.structs.asdict(frame) if frame else None,
        battery=status.battery if status.battery is not None and 0.0 <= status.battery <= 1.0 else None,
        last_seen=utc(seen_ns),
        stale=stale,
    )


def worker_from_load(load: m.WorkerLoad, seen_ns: int, stale: bool) -> Worker:
    stages = {
        name: StageTimes(views=sum(counts), p50_ms=quantile_ms(counts, 0.5), p95_ms=quantile_ms(counts, 0.95))
        for name, counts in load.times.items()
    }
    return resource_from(
        Worker,
        load,
        id=load.worker,
        models=msgspec.structs.asdict(load.models),
        stages=stages,
        last_seen=utc(seen_ns),
        stale=stale,
    )


# --- the system ---------------------------------------------------------------------------------------------------


def readiness_from_nodes(routers: int, alive: dict[str, set[str]]) -> Readiness:
    """Ready means a session to a router, and one living node of each kind in ``NEEDED``. ``alive``: ids by kind."""
    checks = {"router": "connected" if routers else "missing: no session to the router; start it with `surveilnav up`"}
    for kind, command in NEEDED:
        ids = sorted(alive.get(kind, set()))
        checks[kind] = ", ".join(ids) if ids else f"missing: none has announced itself; start one with `{command}`"
    missing = [name for name, found in checks.items() if found.startswith("missing: ")]
    return Readiness(ready=not missing, missing=missing, checks=checks)


def service_from_state(state: m.ServiceState, seen_ns: int, stale: bool) -> Service:
    return resource_from(
        Service, state, id=state.name, restarted=utc(state.restarted_ns), last_seen=utc(seen_ns), stale=stale
    )


# --- recordings ---------------------------------------------------------------------------------------------------


def recording_from_message(recording: m.Recording, recorder: str, root: str = ROOT) -> Recording:
    return resource_from(
        Recording,
        recording,
        started=utc(recording.started_ns),
        changed=utc(recording.changed_ns),
        recorder=recorder,
        file=f"{root}/recordings/{recording.id}/file",
    )


def recorder_from_status(status: m.RecorderStatus, seen_ns: int, stale: bool) -> Recorder:
    return resource_from(Recorder, status, id=status.recorder, last_seen=utc(seen_ns), stale=stale)


def replay_from_status(status: m.ReplayStatus, seen_ns: int, stale: bool) -> Replay:
    return resource_from(Replay, status, began=utc(status.began_ns), last_seen=utc(seen_ns), stale=stale)
