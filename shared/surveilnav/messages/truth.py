"""Simulation only: the key that real backends never subscribe to."""

from __future__ import annotations

from surveilnav.geometry import Pose
from surveilnav.messages.base import Message


class Truth(Message, frozen=True, kw_only=True):
    """Instance ids of a view; the payload is a zstd-compressed uint16 image (height, width), 0: nothing.

    ``labels`` maps instance ids to class names; ``T_world_camera``: where the view was taken from.
    """

    source: str
    view: int
    seq: int
    width_px: int
    height_px: int
    labels: dict[int, str]
    T_world_camera: Pose | None = None


class Judged(Message, frozen=True, kw_only=True):
    """Whether a robot that called ``stop`` stood where it should, by the simulator's rules.

    ``distance_m``: the way from there to the nearest place that counts [m]; None: no way leads there.
    """

    mission: str
    robot: str
    success: bool
    distance_m: float | None = None
