"""Foxglove's small messages, made of ours: times, poses, colours."""

from __future__ import annotations

from collections.abc import Iterable

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose as DrawnPose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from surveilnav.geometry import Pose

#: The frame in which everything is drawn.
WORLD = "world"
_UPRIGHT = (0.0, 0.0, 0.0, 1.0)
_TEXT_HEIGHT_M = 0.18


def time_of(stamp_ns: int) -> Timestamp:
    """A stamp as protobuf has it."""
    stamp_ns = max(0, stamp_ns)
    return Timestamp(seconds=stamp_ns // 10**9, nanos=stamp_ns % 10**9)


def at(x_m: float, y_m: float, z_m: float) -> DrawnPose:
    """A place in the world, upright."""
    return pose_of(Pose((x_m, y_m, z_m), _UPRIGHT))


def pose_of(pose: Pose) -> DrawnPose:
    """A pose in the world."""
    (x, y, z), (qx, qy, qz, qw) = pose.translation_m, pose.quaternion_xyzw
    return DrawnPose(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


def points(path_m: Iterable[tuple[float, float, float]]) -> list[Point3]:
    """Points (x, y, z) [m, world]."""
    return [Point3(x=x, y=y, z=z) for x, y, z in path_m]


def colour(rgb: int, alpha: float = 1.0) -> Color:
    """0xRRGGBB."""
    return Color(r=(rgb >> 16 & 255) / 255, g=(rgb >> 8 & 255) / 255, b=(rgb & 255) / 255, a=alpha)


def label(text: str, place: DrawnPose, rgb: int) -> TextPrimitive:
    """A word that always faces who looks."""
    return TextPrimitive(pose=place, billboard=True, font_size=_TEXT_HEIGHT_M, color=colour(rgb), text=text)
