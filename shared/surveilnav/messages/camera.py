"""Surveillance cameras: who they are, what they last saw, and what may be asked of them."""

from __future__ import annotations

from typing import Literal

import msgspec

from surveilnav.geometry import Pinhole, Pose
from surveilnav.messages.base import Message


class CameraViewInfo(msgspec.Struct, frozen=True):
    """One direction that a camera looks in."""

    view: int
    T_world_camera: Pose


class CameraInfo(Message, frozen=True, kw_only=True):
    """A surveillance camera: place (world, metres), views, delivery tier. ``mounting_offset_m``: the paper's delta z^c.

    ``paused``: a person has it look at nothing, and send nothing, whoever listens.
    """

    camera: str
    floor: str
    position_m: tuple[float, float, float]
    mounting_offset_m: float
    intrinsics: Pinhole
    views: list[CameraViewInfo]
    tier: Literal["jpeg+depth"] = "jpeg+depth"
    paused: bool = False


class CameraSummary(Message, frozen=True, kw_only=True):
    """Labels and confidences that a camera last saw, at most 512 bytes: for choosing the floor."""

    camera: str
    floor: str
    labels: dict[str, float]


class CameraRequest(Message, frozen=True, kw_only=True):
    """Asks a camera to put views again (on their frame keys), to answer with a thumbnail (JPEG payload), or to pause or
    resume (no views): while it is paused it refuses the others as "paused". ``width_px``: of the thumbnail, at most what
    the camera's settings say; 0: that."""

    action: Literal["resend", "thumbnail", "pause", "resume"]
    views: list[int] = []
    width_px: int = 0


class SlotClaim(Message, frozen=True, kw_only=True):
    """A camera process without a name asks the camera plan for a free slot. ``node``: its random id."""

    node: str
