"""A view as Foxglove shows it: the picture, the camera's calibration and pose, and for a robot also its own pose."""

from __future__ import annotations

import msgspec
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

from surveilnav.messages import FrameHeader, LoggedView, Observation
from surveilnav.sensing.packing import picture_jpeg
from surveilnav.services.recorder.core.mcap_message import McapMessage, encode_foxglove
from surveilnav.services.recorder.core.shapes import WORLD, to_pose, to_timestamp

_HEADER = msgspec.msgpack.Decoder(FrameHeader)
_OBSERVATION = msgspec.msgpack.Decoder(Observation)


def decode_header(view: LoggedView) -> FrameHeader:
    """The header that a picture was sent with; a robot's is an Observation. Raises msgspec.DecodeError."""
    return (_OBSERVATION if view.source.startswith("robot/") else _HEADER).decode(view.header)


def view_messages(view: LoggedView, payload: bytes, log_ns: int) -> list[McapMessage]:
    """The messages of a logged view; none if its picture couldn't be used. Raises msgspec.DecodeError for a bad header,
    WireError for a picture that can't be shown."""
    if not payload:
        return []
    header = decode_header(view)
    topic = f"/{view.source}" if isinstance(header, Observation) else f"/{view.source}/view_{view.view}"
    stamp, frame = to_timestamp(header.stamp_ns), topic.strip("/")
    camera_pose = to_pose(header.T_world_camera)
    picture = CompressedImage(timestamp=stamp, frame_id=frame, data=picture_jpeg(header, payload), format="jpeg")
    transform = FrameTransform(
        timestamp=stamp,
        parent_frame_id=WORLD,
        child_frame_id=frame,
        translation=camera_pose.position,
        rotation=camera_pose.orientation,
    )
    calibration = _calibration(header, frame)
    named = [("/tf", transform), (f"{topic}/calibration", calibration), (f"{topic}/picture", picture)]
    messages = [encode_foxglove(name, message, log_ns, header.stamp_ns) for name, message in named]
    if isinstance(header, Observation):
        robot_pose = PoseInFrame(timestamp=stamp, frame_id=WORLD, pose=to_pose(header.T_world_base))
        messages.append(encode_foxglove(f"{topic}/pose", robot_pose, log_ns, header.stamp_ns))
    return messages


def _calibration(header: FrameHeader, frame: str) -> CameraCalibration:
    c = header.camera
    k = [c.fx_px, 0.0, c.cx_px, 0.0, c.fy_px, c.cy_px, 0.0, 0.0, 1.0]
    projection = [c.fx_px, 0.0, c.cx_px, 0.0, 0.0, c.fy_px, c.cy_px, 0.0, 0.0, 0.0, 1.0, 0.0]
    return CameraCalibration(
        timestamp=to_timestamp(header.stamp_ns),
        frame_id=frame,
        width=c.width_px,
        height=c.height_px,
        K=k,
        P=projection,
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
    )
