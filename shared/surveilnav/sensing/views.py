"""Views and perception's results as arrays.

``surveilnav.messages`` has the corresponding messages; ``surveilnav.sensing.packing`` and ``replies`` convert between the two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.messages.view import MEASURED, DepthSource, DepthUncertainty

#: In steeper views detectors recognise nothing: they weren't trained on objects seen from above.
_MAX_DOWN_RAD = math.radians(75.0)


@dataclass(frozen=True, slots=True, eq=False)
class LaserScan:
    """A planar scan. Beam i points in the direction ``start_rad + i * step_rad`` of the world.

    Attributes:
        origin_m: (x, y, z) of the scanner [m, world].
        ranges_m: (N,) float32: how far each beam is known to go; 0: unknown.
        ends: (N,) bool: whether it ended at something there.
    """

    origin_m: tuple[float, float, float]
    start_rad: float
    step_rad: float
    ranges_m: NDArray[np.float32]
    ends: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class PosedView:
    """One RGB-D picture with its pose.

    Attributes:
        source: "robot/<id>" or "camera/<id>".
        view: index of a camera's view (0-12); 0 for a robot.
        seq: sequence number, one more for each picture of a source.
        stamp_ns: time of capture.
        floor: the floor on which the source reports to be.
        T_world_camera: (4, 4) float64 pose of the camera, OpenCV axes.
        camera: intrinsics of both pictures (registered).
        mounting_offset_m: height of the sensor above its floor (the paper's delta z).
        rgb: (height, width, 3) uint8.
        depth_m: (height, width) float32 [m] along the optical axis; 0 or NaN where there is none.
        depth_range_m: (nearest, farthest) depth that the sensor measures.
        depth_source: where the depth comes from; "none": no pixel has one.
        depth_uncertainty: of an estimated depth.
        scan: of a robot's laser scanner, if it has one.
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
    depth_source: DepthSource = "sensor"
    depth_uncertainty: DepthUncertainty = MEASURED
    scan: LaserScan | None = None

    @property
    def is_robot(self) -> bool:
        return self.source.startswith("robot/")

    @property
    def floor_z_m(self) -> float:
        """Estimated altitude of the floor below the source (the paper's z-hat, before eq. 1)."""
        return float(self.T_world_camera[2, 3]) - self.mounting_offset_m


@dataclass(frozen=True, slots=True, eq=False)
class DetectedObject:
    """One object that a detector found in one view.

    Attributes:
        label: its class, in canonical spelling (``surveilnav.words.canonical``).
        score: the detector's score, 0-1.
        box_px: (x0, y0, x1, y1) float pixels.
        mask: (rows, columns) bool for the box rounded outwards to whole pixels and clipped to the picture (``box_cells``);
            None: the whole box.
        embedding: (D,) float32, unit length.
        chance: calibrated probability that the label is right, 0-1 (``perception.chances``); None: not calibrated.
    """

    label: str
    score: float
    box_px: tuple[float, float, float, float]
    mask: NDArray[np.bool_] | None
    embedding: NDArray[np.float32]
    chance: float | None = None

    @property
    def confidence(self) -> float:
        """How sure the label is, 0-1: ``chance`` if the detection is calibrated, else the detector's ``score``."""
        return self.score if self.chance is None else self.chance


@dataclass(frozen=True, slots=True, eq=False)
class ViewPerception:
    """Perception's result for one view.

    Attributes:
        backend: name of the backend.
        detections: the objects that it found.
        image_embedding: (D,) float32, unit length.
        embedding_model: id of the space of all these embeddings; those of two models can't be compared.
        words: what the detector looked for: the prompts, or all classes of its vocabulary.
    """

    backend: str
    detections: tuple[DetectedObject, ...]
    image_embedding: NDArray[np.float32]
    embedding_model: str = ""
    words: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class TrueInstances:
    """Simulation only: which instance each pixel shows. Fusion and planner never get it.

    Attributes:
        ids: (height, width) uint16 instance ids, 0 where there is none.
        labels: by instance id, the class.
        T_world_camera: pose of the view, if known. ``simulated`` draws correlated errors for views from similar directions.
    """

    ids: NDArray[np.uint16]
    labels: dict[int, str] = field(default_factory=dict)
    T_world_camera: Matrix4 | None = None


def measured_depth_m(depth_m: NDArray[np.float32], source: DepthSource) -> NDArray[np.float32]:
    """The depth (H, W) [m] that detectors may use: none (0) where it is only estimated.

    Detectors learnt from measured depth. With estimated depth, ``compact`` finds less than with none
    (docs/results/real_cameras.md).
    """
    return depth_m if source == "sensor" else np.zeros_like(depth_m)


def box_cells(box_px: tuple[float, float, float, float], width_px: int, height_px: int) -> tuple[int, int, int, int]:
    """The box (x0, y0, x1, y1) rounded outwards to whole pixels and clipped to the picture, for slices ``[y0:y1, x0:x1]``."""
    x0, y0, x1, y1 = box_px
    left, top = max(0, int(np.floor(x0))), max(0, int(np.floor(y0)))
    right, bottom = min(width_px, int(np.ceil(x1))), min(height_px, int(np.ceil(y1)))
    return left, top, max(left, right), max(top, bottom)


def looks_straight_down(T_world_camera: Matrix4) -> bool:
    """Whether a camera with this pose (4, 4) looks down so steeply that detectors recognise nothing."""
    return float(T_world_camera[2, 2]) < -math.sin(_MAX_DOWN_RAD)
