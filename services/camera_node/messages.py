"""The camera's messages, made of its source."""

from __future__ import annotations

from surveilnav.messages import CameraInfo, CameraViewInfo, FrameHeader
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.frames import EncodedFrame
from surveilnav.services.camera_node.sources.source import Source


def camera_info(source: Source, settings: CameraSettings, *, paused: bool, now_ns: int) -> CameraInfo:
    """The description of a camera. Without depth, it sends its pictures as ``jpeg``."""
    place = source.place
    return CameraInfo(
        stamp_ns=now_ns,
        camera=place.name,
        floor=place.floor,
        position_m=place.position_m,
        mounting_offset_m=place.mounting_offset_m,
        intrinsics=source.intrinsics,
        views=[CameraViewInfo(v, pose) for v, pose in enumerate(source.views)],
        tier="jpeg" if settings.tier == "jpeg+depth" and not source.has_depth else settings.tier,
        budget_bytes_s=1000.0 * (settings.budget_kb_s or 0.0),
        label=place.label,
        stream=source.stream,
        paused=paused,
    )


def frame_header(source: Source, view: int, seq: int, frame: EncodedFrame, *, now_ns: int) -> FrameHeader:
    """The header of a frame; its stamp is the time of capture."""
    place = source.place
    return FrameHeader(
        stamp_ns=frame.captured_ns or now_ns,
        source=f"camera/{place.name}",
        view=view,
        seq=seq,
        floor=place.floor,
        T_world_camera=source.views[view],
        camera=source.intrinsics,
        mounting_offset_m=place.mounting_offset_m,
        depth_range_m=source.depth_range_m,
        image=frame.image,
        depth=frame.depth,
        clock=frame.clock,
        depth_source=frame.depth_source,
        depth_uncertainty=frame.depth_uncertainty,
        tier=frame.tier,
        perceived=frame.perceived,
    )
