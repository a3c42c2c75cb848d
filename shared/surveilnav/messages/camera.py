"""Messages of surveillance cameras."""

from __future__ import annotations

from typing import Literal

import msgspec

from surveilnav.geometry import Pinhole, Pose
from surveilnav.messages.base import Message
from surveilnav.messages.view import TierChoice

#: What a camera's stream is doing (``services/camera_node/core/stream_health.py`` defines each state).
StreamState = Literal["connecting", "live", "no_frames", "frozen", "black", "grey", "garbled", "moved", "failed"]


class StreamStatus(msgspec.Struct, frozen=True):
    """What a camera's stream is doing.

    Attributes:
        reason: details, for people; it never holds an address.
        since_ns: when the state began; 0: always.
        n_reconnects: how often the stream was opened anew.
        n_bytes: bytes that came from the camera since its node started. They aren't on the bus, and counted nowhere else.
    """

    state: StreamState = "live"
    reason: str = ""
    since_ns: int = 0
    n_reconnects: int = 0
    n_bytes: int = 0


class CameraViewInfo(msgspec.Struct, frozen=True):
    """One of the directions that a camera looks in."""

    view: int
    T_world_camera: Pose


class CameraInfo(Message, frozen=True, kw_only=True):
    """Describes a surveillance camera.

    Attributes:
        position_m: (x, y, z) in the world.
        mounting_offset_m: height above the floor, the paper's delta z^c.
        intrinsics: of all views, for colour and depth.
        tier: how much it sends of its views.
        budget_bytes_s: how many bytes of frames it may send; 0: as many as it has.
        label: its name for people; empty: as ``camera``.
        stream: what its stream is doing.
        paused: a person has paused it: it sends nothing, whoever listens.
    """

    camera: str
    floor: str
    position_m: tuple[float, float, float]
    mounting_offset_m: float
    intrinsics: Pinhole
    views: list[CameraViewInfo]
    tier: TierChoice = "jpeg+depth"
    budget_bytes_s: float = 0.0
    label: str = ""
    stream: StreamStatus = StreamStatus()
    paused: bool = False


class CameraSummary(Message, frozen=True, kw_only=True):
    """What the camera's own detector has found: label -> confidence. At most 512 bytes; used to choose the floor."""

    camera: str
    floor: str
    labels: dict[str, float]


class CameraRequest(Message, frozen=True, kw_only=True):
    """A request to a camera. While it is paused it refuses all but "resume" as "paused".

    Attributes:
        action: "resend": publish the views again; "order": what waits for the budget is wanted in this order; "thumbnail":
            answer with a JPEG of the first view; "pause" or "resume".
        views: indices of the views; empty for "pause" and "resume".
        pictures: of "resend": the views are wanted with their pictures from now on, also by a camera that sends less than that.
        width_px: width of the thumbnail; 0: the largest that the camera's settings allow.
    """

    action: Literal["resend", "order", "thumbnail", "pause", "resume"]
    views: list[int] = []
    pictures: bool = False
    width_px: int = 0
