"""The header of a picture. The pixels themselves are the raw payload beside it."""

from __future__ import annotations

from typing import Literal

import msgspec

from surveilnav.geometry import Pinhole, Pose
from surveilnav.messages.base import Message


class PayloadPart(msgspec.Struct, frozen=True):
    """One stretch of the payload: how it is encoded, and how many bytes it takes."""

    encoding: Literal["jpeg", "depth-invq-zstd"]
    n_bytes: int


class FrameHeader(Message, frozen=True, kw_only=True):
    """Describes an RGB-D picture; travels as attachment, its payload is ``image`` then ``depth``.

    ``T_world_camera`` maps the OpenCV camera frame to the world; ``floor`` names the floor the source
    stands on; ``mounting_offset_m`` is the sensor's height above that floor; ``depth_range_m`` is
    (nearest, farthest) measurable depth.
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
