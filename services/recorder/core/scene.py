"""Objects, cameras and the plan as Foxglove draws them in space."""

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
from surveilnav.services.recorder.core.line import Line, drawn_line
from surveilnav.services.recorder.core.shapes import WORLD, at, colour, label, points, pose_of, time_of

_STATUS_RGB = {"candidate": 0xE8A33D, "confirmed": 0x2E9E5B, "rejected": 0x9AA0A6}
_INVOKED_RGB, _IDLE_RGB, _PAUSED_RGB = 0x2F80ED, 0x9AA0A6, 0xC0392B
_PATH_RGB, _WAYPOINT_RGB, _OTHER_RGB = 0x8E44AD, 0xD81B60, 0xBFA3C9
_CONE_M, _PATH_HEIGHT_M = 0.6, 0.05


def objects_line(objects: ObjectList, log_ns: int) -> Line:
    """A box and a word for each object of a floor; those that are gone go."""
    entities = [_object(o, objects.stamp_ns) for o in objects.objects]
    return _scene(f"/objects/{objects.floor}", entities, objects.stamp_ns, log_ns)


def cameras_line(infos: Iterable[CameraInfo], invoked: Collection[str], stamp_ns: int, log_ns: int) -> Line:
    """A box for each camera and a line for each of its views: blue while it is invoked."""
    return _scene("/cameras", [_camera(i, i.camera in invoked, stamp_ns) for i in infos], stamp_ns, log_ns)


def plan_line(plan: Plan, floor_z_m: float, log_ns: int) -> Line:
    """The path to the waypoint, and all that was weighed."""
    z_m = floor_z_m + _PATH_HEIGHT_M
    entity = _entity("plan", plan.stamp_ns)
    path = LinePrimitive(
        type=LinePrimitive.LINE_STRIP,
        pose=at(0, 0, 0),
        thickness=0.04,
        color=colour(_PATH_RGB),
        points=points((x, y, z_m) for x, y in plan.path_m),
    )
    entity.lines.append(path)
    weighed = [*plan.candidates, *([plan.waypoint] if plan.waypoint else [])]
    for candidate in weighed:
        _add_candidate(entity, candidate, z_m, chosen=candidate is plan.waypoint or candidate.chosen)
    return _scene("/plan", [entity], plan.stamp_ns, log_ns)


def _object(o: ObjectRecord, stamp_ns: int) -> SceneEntity:
    rgb, (x, y, z) = _STATUS_RGB[o.status], o.center_m
    entity = _entity(f"object_{o.floor}_{o.id}", stamp_ns)
    size = Vector3(x=max(o.size_m[0], 0.02), y=max(o.size_m[1], 0.02), z=max(o.size_m[2], 0.02))
    entity.cubes.append(CubePrimitive(pose=at(x, y, z), size=size, color=colour(rgb, 0.35)))
    entity.texts.append(label(f"{o.label} {o.confidence:.2f}", at(x, y, z + o.size_m[2] / 2 + 0.15), rgb))
    for key, value in (("status", o.status), ("sources", ", ".join(o.sources)), ("reason", o.reason)):
        entity.metadata.add(key=key, value=value)
    return entity


def _camera(info: CameraInfo, invoked: bool, stamp_ns: int) -> SceneEntity:
    rgb = _PAUSED_RGB if info.paused else _INVOKED_RGB if invoked else _IDLE_RGB
    entity = _entity(f"camera_{info.camera}", stamp_ns)
    place = at(*info.position_m)
    entity.cubes.append(CubePrimitive(pose=place, size=Vector3(x=0.12, y=0.12, z=0.12), color=colour(rgb)))
    entity.texts.append(label(info.camera, at(*info.position_m[:2], info.position_m[2] + 0.2), rgb))
    for view in info.views:
        ahead = LinePrimitive(
            type=LinePrimitive.LINE_LIST,
            pose=pose_of(view.T_world_camera),
            thickness=0.02,
            color=colour(rgb, 0.6),
            points=points([(0.0, 0.0, 0.0), (0.0, 0.0, _CONE_M)]),
        )
        entity.lines.append(ahead)
    return entity


def _add_candidate(entity: SceneEntity, candidate: Candidate, z_m: float, *, chosen: bool) -> None:
    rgb, size_m = (_WAYPOINT_RGB, 0.25) if chosen else (_OTHER_RGB, 0.15)
    place = at(candidate.x_m, candidate.y_m, z_m)
    size = Vector3(x=size_m, y=size_m, z=size_m)
    entity.spheres.append(SpherePrimitive(pose=place, size=size, color=colour(rgb, 0.8)))
    entity.texts.append(
        label(f"{candidate.kind} {candidate.score:.2f}", at(candidate.x_m, candidate.y_m, z_m + 0.25), rgb)
    )


def _entity(id: str, stamp_ns: int) -> SceneEntity:
    return SceneEntity(timestamp=time_of(stamp_ns), frame_id=WORLD, id=id)


def _scene(topic: str, entities: list[SceneEntity], stamp_ns: int, log_ns: int) -> Line:
    """A topic's whole scene: what was there before goes."""
    everything = SceneEntityDeletion(timestamp=time_of(stamp_ns), type=SceneEntityDeletion.ALL)
    return drawn_line(topic, SceneUpdate(deletions=[everything], entities=entities), log_ns, stamp_ns)
