"""Views and what perception says about them, as arrays: the input of every core.

The wire's twins are in ``surveilnav.messages``; ``surveilnav.sensing.packing`` turns one into the other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4, Pinhole

#: Steeper views than this show nothing that a detector knows: it can't read what is seen from straight above.
_NADIR_RAD = math.radians(75.0)


@dataclass(frozen=True, slots=True, eq=False)
class PosedView:
    """One RGB-D picture with its pose: all that fusion may know about the world.

    Attributes:
        source: "robot/<id>" or "camera/<id>".
        view: index of the view of a camera (0-12); 0 for a robot.
        seq: grows by one with every observation of a source.
        stamp_ns: time of capture.
        floor: the floor that the source says it stands on.
        T_world_camera: (4, 4) float64, OpenCV camera.
        camera: intrinsics of both pictures (registered).
        mounting_offset_m: height of the sensor above its floor (the paper's delta z).
        rgb: (height, width, 3) uint8.
        depth_m: (height, width) float32 [m] along the optical axis; 0 or NaN where there is none.
        depth_range_m: (nearest, farthest) that the sensor measures.
    """

    source: str
    view: int
    seq: int
    stamp_ns: int
    floor: str
    T_world_camera: Matrix4
    camera: Pinhole
    mounting_offset_m: float
    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    depth_range_m: tuple[float, float]

    @property
    def is_robot(self) -> bool:
        return self.source.startswith("robot/")

    @property
    def floor_z_m(self) -> float:
        """Estimated altitude of the supporting floor (the paper's z-hat, before eq. 1)."""
        return float(self.T_world_camera[2, 3]) - self.mounting_offset_m


@dataclass(frozen=True, slots=True, eq=False)
class DetectedObject:
    """One object that a detector found in one view.

    Attributes:
        label: what it is called, as ``surveilnav.words.canonical`` spells it.
        score: the detector's confidence, 0-1.
        box_px: (x0, y0, x1, y1) float pixels.
        mask: (y1 - y0, x1 - x0) bool for the box rounded outwards to whole pixels and clipped to the image
            (``box_cells``), or None: the whole box.
        embedding: (D,) float32, unit length.
        chance: how likely it is what it is called, 0-1, by the backend's table (``perception.chances``); None: it has none.
    """

    label: str
    score: float
    box_px: tuple[float, float, float, float]
    mask: NDArray[np.bool_] | None
    embedding: NDArray[np.float32]
    chance: float | None = None

    @property
    def confidence(self) -> float:
        """``chance``; the score, where that is all that is known."""
        return self.score if self.chance is None else self.chance


@dataclass(frozen=True, slots=True, eq=False)
class ViewPerception:
    """What perception says about one view.

    ``image_embedding`` is (D,) float32, unit length. ``embedding_model`` names the space of all its vectors: those of two
    models can't be compared. ``words``: what the detector looked for; one with a vocabulary looks for all of it.
    """

    backend: str
    detections: tuple[DetectedObject, ...]
    image_embedding: NDArray[np.float32]
    embedding_model: str = ""
    words: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class TrueInstances:
    """Simulation only: which instance each pixel shows. Never reaches fusion or planner.

    ``ids`` is (height, width) uint16, 0 where no instance is; ``labels`` maps instance ids to class names.
    ``T_world_camera`` is the view's pose where it is told: views from the same direction share their luck.
    """

    ids: NDArray[np.uint16]
    labels: dict[int, str] = field(default_factory=dict)
    T_world_camera: Matrix4 | None = None


def box_cells(box_px: tuple[float, float, float, float], width_px: int, height_px: int) -> tuple[int, int, int, int]:
    """The box (x0, y0, x1, y1) rounded outwards to whole pixels and clipped: slices ``[y0:y1, x0:x1]``."""
    x0, y0, x1, y1 = box_px
    left, top = max(0, int(np.floor(x0))), max(0, int(np.floor(y0)))
    right, bottom = min(width_px, int(np.ceil(x1))), min(height_px, int(np.ceil(y1)))
    return left, top, max(left, right), max(top, bottom)


def looks_straight_down(T_world_camera: Matrix4) -> bool:
    """Whether a camera (4, 4) looks down so steeply that no detector can read what it sees."""
    return float(T_world_camera[2, 2]) < -math.sin(_NADIR_RAD)
