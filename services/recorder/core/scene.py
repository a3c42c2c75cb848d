"""Objects, cameras and the plan as Foxglove shows them in 3D."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

from surveilnav.messages import CameraInfo, Candidate, ObjectList, ObjectRecord, Plan
from surveilnav.services.recorder.core.mcap_message import McapMessage, encode_foxglove
from surveilnav.services.recorder.core.shapes import (
    WORLD,
    text_label,
    to_colour,
    to_points,
    to_pose,
    to_timestamp,
    upright_pose,
)

_STATUS_RGB = {"candidate": 0xE8A33D, "confirmed": 0x2E9E5B, "rejected": 0x9AA0A6}
_INVOKED_RGB, _IDLE_RGB, _PAUSED_RGB = 0x2F80ED, 0x9AA0A6, 0xC0392B
_PATH_RGB, _WAYPOINT_RGB, _OTHER_RGB = 0x8E44AD, 0xD81B60, 0xBFA3C9
_CONE_M, _PATH_HEIGHT_M = 0.6, 0.05


def objects_message(objects: ObjectList, log_ns: int) -> McapMessage:
    """A box with a label for each object of a floor. They replace those drawn before."""
    entities = [_object(o, objects.stamp_ns) for o in objects.objects]
    return _scene(f"/objects/{objects.floor}", entities, objects.stamp_ns, log_ns)


def cameras_message(infos: Iterable[CameraInfo], invoked: Collection[str], stamp_ns: int, log_ns: int) -> McapMessage:
    """A box for each camera and a line along each of its views, blue while the camera is invoked."""
    return _scene("/cameras", [_camera(i, i.camera in invoked, stamp_ns) for i in infos], stamp_ns, log_ns)


def plan_message(plan: Plan, floor_z_m: float, log_ns: int) -> McapMessage:
    """The path to the waypoint, and the candidates."""
    z_m = floor_z_m + _PATH_HEIGHT_M
    entity = _entity("plan", plan.stamp_ns)
    path = LinePrimitive(
        type=LinePrimitive.LINE_STRIP,
        pose=upright_pose(0, 0, 0),
        thickness=0.04,
        color=to_colour(_PATH_RGB),
        points=to_points((x, y, z_m) for x, y in plan.path_m),
    )
    entity.lines.append(path)
    candidates = [*plan.candidates, *([plan.waypoint] if plan.waypoint else [])]
    for candidate in candidates:
        _add_candidate(entity, candidate, z_m, chosen=candidate is plan.waypoint or candidate.chosen)
    return _scene("/plan", [entity], plan.stamp_ns, log_ns)


def _object(o: ObjectRecord, stamp_ns: int) -> SceneEntity:
    rgb, (x, y, z) = _STATUS_RGB[o.status], o.center_m
    entity = _entity(f"object_{o.floor}_{o.id}", stamp_ns)
    size = Vector3(x=max(o.size_m[0], 0.02), y=max(o.size_m[1], 0.02), z=max(o.size_m[2], 0.02))
    entity.cubes.append(CubePrimitive(pose=upright_pose(x, y, z), size=size, color=to_colour(rgb, 0.35)))
    entity.texts.append(
        text_label(f"{o.label} {o.confidence:.2f}", upright_pose(x, y, z + o.size_m[2] / 2 + 0.15), rgb)
    )
    for key, value in (("status", o.status), ("sources", ", ".join(o.sources)), ("reason", o.reason)):
        entity.metadata.add(key=key, value=value)
    return entity


def _camera(info: CameraInfo, invoked: bool, stamp_ns: int) -> SceneEntity:
    rgb = _PAUSED_RGB if info.paused else _INVOKED_RGB if invoked else _IDLE_RGB
    entity = _entity(f"camera_{info.camera}", stamp_ns)
    place = upright_pose(*info.position_m)
    entity.cubes.append(CubePrimitive(pose=place, size=Vector3(x=0.12, y=0.12, z=0.12), color=to_colour(rgb)))
    entity.texts.append(text_label(info.camera, upright_pose(*info.position_m[:2], info.position_m[2] + 0.2), rgb))
    for view in info.views:
        ahead = LinePrimitive(
            type=LinePrimitive.LINE_LIST,
            pose=to_pose(view.T_world_camera),
            thickness=0.02,
            color=to_colour(rgb, 0.6),
            points=to_points([(0.0, 0.0, 0.0), (0.0, 0.0, _CONE_M)]),
        )
        entity.lines.append(ahead)
    return entity


def _add_candidate(entity: SceneEntity, candidate: Candidate, z_m: float, *, chosen: bool) -> None:
    rgb, size_m = (_WAYPOINT_RGB, 0.25) if chosen else (_OTHER_RGB, 0.15)
    place = upright_pose(candidate.x_m, candidate.y_m, z_m)
    size = Vector3(x=size_m, y=size_m, z=size_m)
    entity.spheres.append(SpherePrimitive(pose=place, size=size, color=to_colour(rgb, 0.8)))
    worth = f"{candidate.utility:.3g}"
    if candidate.chance is not None and candidate.cost_m is not None:
        worth = f"{candidate.chance:.0%} in {candidate.cost_m:.1f} m"
    above = upright_pose(candidate.x_m, candidate.y_m, z_m + 0.25)
    entity.texts.append(text_label(f"{candidate.kind} {worth}", above, rgb))


def _entity(id: str, stamp_ns: int) -> SceneEntity:
    return SceneEntity(timestamp=to_timestamp(stamp_ns), frame_id=WORLD, id=id)


def _scene(topic: str, entities: list[SceneEntity], stamp_ns: int, log_ns: int) -> McapMessage:
    """The whole scene of a topic, which replaces the one before."""
    everything = SceneEntityDeletion(timestamp=to_timestamp(stamp_ns), type=SceneEntityDeletion.ALL)
    return encode_foxglove(topic, SceneUpdate(deletions=[everything], entities=entities), log_ns, stamp_ns)
