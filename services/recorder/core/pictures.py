"""A view as Foxglove draws it: its picture, the camera that took it, where that was; for a robot also its pose."""

from __future__ import annotations

import msgspec
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

from surveilnav.messages import FrameHeader, LoggedView, Observation
from surveilnav.services.recorder.core.line import Line, drawn_line
from surveilnav.services.recorder.core.shapes import WORLD, pose_of, time_of

_HEADER = msgspec.msgpack.Decoder(FrameHeader)
_OBSERVATION = msgspec.msgpack.Decoder(Observation)


def header_of(view: LoggedView) -> FrameHeader:
    """What stood beside the picture; of a robot an Observation. msgspec.DecodeError: it can't be read."""
    return (_OBSERVATION if view.source.startswith("robot/") else _HEADER).decode(view.header)


def view_lines(view: LoggedView, payload: bytes, log_ns: int) -> list[Line]:
    """Lines of a logged view; none where its picture was of no use. msgspec.DecodeError: its header can't be read."""
    if not payload:
        return []
    header = header_of(view)
    topic = f"/{view.source}" if isinstance(header, Observation) else f"/{view.source}/view_{view.view}"
    stamp, frame = time_of(header.stamp_ns), topic.strip("/")
    pose = pose_of(header.T_world_camera)
    picture = CompressedImage(timestamp=stamp, frame_id=frame, data=payload[: header.image.n_bytes], format="jpeg")
    placed = FrameTransform(
        timestamp=stamp,
        parent_frame_id=WORLD,
        child_frame_id=frame,
        translation=pose.position,
        rotation=pose.orientation,
    )
    drawn = [("/tf", placed), (f"{topic}/calibration", _calibration(header, frame)), (f"{topic}/picture", picture)]
    lines = [drawn_line(name, message, log_ns, header.stamp_ns) for name, message in drawn]
    if isinstance(header, Observation):
        standing = PoseInFrame(timestamp=stamp, frame_id=WORLD, pose=pose_of(header.T_world_base))
        lines.append(drawn_line(f"{topic}/pose", standing, log_ns, header.stamp_ns))
    return lines


def _calibration(header: FrameHeader, frame: str) -> CameraCalibration:
    c = header.camera
    k = [c.fx_px, 0.0, c.cx_px, 0.0, c.fy_px, c.cy_px, 0.0, 0.0, 1.0]
    projection = [c.fx_px, 0.0, c.cx_px, 0.0, 0.0, c.fy_px, c.cy_px, 0.0, 0.0, 0.0, 1.0, 0.0]
    return CameraCalibration(
        timestamp=time_of(header.stamp_ns),
        frame_id=frame,
        width=c.width_px,
        height=c.height_px,
        K=k,
        P=projection,
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
    )
