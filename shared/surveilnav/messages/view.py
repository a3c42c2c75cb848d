"""The header of an RGB-D picture, whose encoded pixels are the raw payload beside it."""

from __future__ import annotations

from typing import Final, Literal

import msgspec

from surveilnav.geometry import Pinhole, Pose
from surveilnav.messages.base import Message

#: How a picture's time of capture is known: by the camera's own clock (RTCP), as the time of arrival, or by the file's time.
CaptureClock = Literal["camera", "arrival", "file"]
#: Where depth comes from: a sensor measured it, a network estimated it, it follows from the floor's plane, or there is none.
DepthSource = Literal["sensor", "network", "geometry", "none"]


#: What a camera sends of a view, from most to least. ``surveilnav.sensing.tiers`` says what each of them holds.
Tier = Literal["raw", "jpeg+depth", "jpeg", "features", "objects"]
#: A camera's setting: a tier, or that it chooses one for each view.
TierChoice = Literal[Tier, "auto"]
#: The tiers in which a camera sends what it sees itself, and less than its whole picture.
PERCEIVED_TIERS: Final[tuple[Tier, ...]] = ("features", "objects")


class PayloadPart(msgspec.Struct, frozen=True, omit_defaults=True):
    """One part of a payload: its encoding and its size.

    Attributes:
        divisor: each of its pixels stands for a square of so many of the view's pixels a side. A JPEG says its size itself, so
            this is for depth and masks.
        quantum_per_m: a step of inverse depth; for depth alone.
    """

    encoding: Literal["jpeg", "png", "depth-invq-zstd", "perceived-zstd"]
    n_bytes: int
    divisor: int = 1
    quantum_per_m: float = 0.001


class DepthUncertainty(msgspec.Struct, frozen=True):
    """How uncertain an estimated depth is, as standard deviations of its logarithm (0.1: about 10 %).

    Attributes:
        scale_sigma: of a factor that all depths of a picture have in common.
        sigma: of what remains, which differs across the picture.
    """

    sigma: float = 0.0
    scale_sigma: float = 0.0


#: Of depth that a sensor measured, whose noise is known otherwise.
MEASURED = DepthUncertainty()


class ScanHeader(msgspec.Struct, frozen=True, kw_only=True):
    """A planar laser scan of a robot, taken at about the time of its picture.

    Attributes:
        origin_m: (x, y, z) of the scanner [m, world].
        start_rad: direction of the first beam in the world; ``step_rad``: from one beam to the next, anticlockwise if positive.
        ranges_mm: a uint16 (little endian) for each beam: where it ended, 0: unknown, 65535: at nothing within ``max_range_m``.
    """

    origin_m: tuple[float, float, float]
    start_rad: float
    step_rad: float
    max_range_m: float
    ranges_mm: bytes


class FrameHeader(Message, frozen=True, kw_only=True):
    """Describes an RGB-D picture; the payload is ``image``, then ``depth``, then ``perceived``.

    Attributes:
        source: "robot/<id>" or "camera/<id>".
        view: index of a camera's view; 0 for a robot.
        seq: sequence number of the picture.
        floor: the floor that the source stands on.
        T_world_camera: pose of the camera, OpenCV axes.
        camera: intrinsics of both pictures.
        mounting_offset_m: height of the camera above the floor.
        depth_range_m: (nearest, farthest) depth that it measures.
        clock: how the time of capture is known, which ``stamp_ns`` is.
        depth_source: where its depth comes from; "none": no pixel has one.
        depth_uncertainty: of an estimated depth.
        tier: how much of the view the payload holds. ``camera`` describes the whole view, whatever a part holds of it.
        perceived: what the sender's own perception saw in it; None: it didn't look. Only ``PERCEIVED_TIERS`` have it.
        scan: of a robot's laser scanner; None: it has none, or none at that time.
    """

    source: str
    view: int
    seq: int
    floor: str
    T_world_camera: Pose
    camera: Pinhole
    mounting_offset_m: float
    depth_range_m: tuple[float, float]
    image: PayloadPart
    depth: PayloadPart
    clock: CaptureClock = "arrival"
    depth_source: DepthSource = "sensor"
    depth_uncertainty: DepthUncertainty = MEASURED
    tier: Tier = "jpeg+depth"
    perceived: PayloadPart | None = None
    scan: ScanHeader | None = None
