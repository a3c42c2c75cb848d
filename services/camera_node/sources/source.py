"""The interface between the camera node and its camera, whatever makes the pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole, Pose
from surveilnav.messages import MEASURED, CaptureClock, DepthSource, DepthUncertainty, StreamStatus
from surveilnav.sensing.views import TrueInstances


@dataclass(frozen=True, slots=True)
class Place:
    """Where a camera is mounted: at ``position_m`` (x, y, z) in the world, ``mounting_offset_m`` above its floor.

    ``label`` is its name for people; empty: as ``name``.
    """

    name: str
    floor: str
    position_m: tuple[float, float, float]
    mounting_offset_m: float
    label: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """What one view shows.

    Attributes:
        version: changes with the picture; the same number means the same picture.
        rgb: (height, width, 3) uint8.
        depth_m: (height, width) float32 [m] along the optical axis, registered; 0 or NaN where there is none.
        truth: which instance each pixel shows. Only simulated cameras know; None for a real one.
        captured_ns: time of capture [ns since 1970]; 0: it shows the present, whenever it is asked for.
        clock: how that time is known.
        depth_source: where ``depth_m`` comes from. ``depth_uncertainty``: see ``FrameHeader``.
    """

    version: int
    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    truth: TrueInstances | None = None
    captured_ns: int = 0
    clock: CaptureClock = "arrival"
    depth_source: DepthSource = "sensor"
    depth_uncertainty: DepthUncertainty = MEASURED


class Source(Protocol):
    """One camera; safe to use from several threads.

    Attributes:
        place: where it is mounted.
        views: ``T_world_camera`` of each view; a fixed camera has one.
        intrinsics: of every view, for colour and depth alike.
        depth_range_m: (nearest, farthest) depth that it measures.
        has_depth: whether its pictures have depth.
    """

    place: Place
    views: Sequence[Pose]
    intrinsics: Pinhole
    depth_range_m: tuple[float, float]
    has_depth: bool

    @property
    def stream(self) -> StreamStatus:
        """What the stream of its pictures is doing."""
        ...

    def version(self, view: int) -> int | None:
        """The version of a view's latest picture, without making the picture; None if there is none yet."""
        ...

    def latest(self, view: int) -> Picture:
        """The latest picture of a view that has one."""
        ...

    def content(self, view: int) -> str:
        """A hash of all that a view's latest picture depends on, without making the picture; the same in every run.

        Empty if that isn't known, as for a real camera: then nothing computed from its pictures is kept between runs.
        """
        ...
