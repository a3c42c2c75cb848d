"""Messages that exist only in simulation; real backends never receive them."""

from __future__ import annotations

from surveilnav.geometry import Pose
from surveilnav.messages.base import Message


class Truth(Message, frozen=True, kw_only=True):
    """Instance ids of a view; the payload is a zstd-compressed uint16 image (height, width), 0 where there is no instance.

    Attributes:
        labels: by instance id, the class.
        T_world_camera: pose of the view.
    """

    source: str
    view: int
    seq: int
    width_px: int
    height_px: int
    labels: dict[int, str]
    T_world_camera: Pose | None = None


class Judged(Message, frozen=True, kw_only=True):
    """Whether a robot that called ``stop`` had found its target, by the benchmark's rule.

    ``distance_m``: distance left to the nearest place that would count; None: no way leads there.
    """

    mission: str
    robot: str
    success: bool
    distance_m: float | None = None
