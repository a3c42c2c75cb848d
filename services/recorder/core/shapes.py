"""Converts times, poses, points and colours to Foxglove's small messages."""

from __future__ import annotations

from collections.abc import Iterable

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose as FoxglovePose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from surveilnav.geometry import Pose

#: The frame that everything is drawn in.
WORLD = "world"
_UPRIGHT = (0.0, 0.0, 0.0, 1.0)
_TEXT_HEIGHT_M = 0.18


def to_timestamp(stamp_ns: int) -> Timestamp:
    """A time stamp [ns] as protobuf's Timestamp."""
    stamp_ns = max(0, stamp_ns)
    return Timestamp(seconds=stamp_ns // 10**9, nanos=stamp_ns % 10**9)


def upright_pose(x_m: float, y_m: float, z_m: float) -> FoxglovePose:
    """A pose at a place [m, world] without rotation."""
    return to_pose(Pose((x_m, y_m, z_m), _UPRIGHT))


def to_pose(pose: Pose) -> FoxglovePose:
    (x, y, z), (qx, qy, qz, qw) = pose.translation_m, pose.quaternion_xyzw
    return FoxglovePose(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


def to_points(path_m: Iterable[tuple[float, float, float]]) -> list[Point3]:
    """Points (x, y, z) [m] as Foxglove's."""
    return [Point3(x=x, y=y, z=z) for x, y, z in path_m]


def to_colour(rgb: int, alpha: float = 1.0) -> Color:
    """A colour 0xRRGGBB and its opacity as Foxglove's."""
    return Color(r=(rgb >> 16 & 255) / 255, g=(rgb >> 8 & 255) / 255, b=(rgb & 255) / 255, a=alpha)


def text_label(text: str, place: FoxglovePose, rgb: int) -> TextPrimitive:
    """A text that always faces the viewer."""
    return TextPrimitive(pose=place, billboard=True, font_size=_TEXT_HEIGHT_M, color=to_colour(rgb), text=text)
