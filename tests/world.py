"""An analytic world for tests and benchmarks of fusion: boxes seen by rays, no renderer."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4, Pinhole, camera_pose
from surveilnav.sensing.views import DetectedObject, PosedView, ViewPerception

Box = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass
class World:
    """An empty room seen from inside, with solid boxes in it. All axis-aligned, (min, max) [m]."""

    room: Box = ((0.0, 0.0, 0.0), (6.0, 4.0, 2.5))
    boxes: dict[str, Box] = field(default_factory=dict)

    def depth(self, T: Matrix4, camera: Pinhole) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """Depth (h, w) [m] and which box each pixel shows (-1: the room)."""
        rays = camera.rays().astype(np.float64) @ T[:3, :3].T
        origin = T[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / rays
            low, high = (np.array(v) for v in self.room)
            t = np.where(rays > 0, (high - origin) * inverse, (low - origin) * inverse)
            depth, shown = np.nanmin(np.where(rays == 0, np.inf, t), axis=-1), np.full(rays.shape[:2], -1)
            for i, (low, high) in enumerate(np.array(b) for b in self.boxes.values()):
                a, b = (low - origin) * inverse, (high - origin) * inverse
                enter, leave = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
                hit = (enter < leave) & (enter > 0) & (enter < depth)
                depth, shown = np.where(hit, enter, depth), np.where(hit, i, shown)
        return depth.astype(np.float32), shown

    def view(
        self,
        x: float,
        y: float,
        yaw: float,
        pitch: float = 0.0,
        *,
        height: float = 0.88,
        source: str = "robot/r",
        view: int = 0,
        seq: int = 0,
        floor: str = "0",
        floor_z: float = 0.0,
        camera: Pinhole | None = None,
        range_m: tuple[float, float] = (0.1, 10.0),
    ) -> PosedView:
        """What somebody at (x, y) sees; ``height`` above the floor, ``yaw`` and ``pitch`` [rad]."""
        camera = camera or Pinhole.from_hfov(160, 120, math.radians(79))
        T = camera_pose((x, y, floor_z + height), yaw, pitch)
        local = T.copy()
        local[2, 3] = height
        depth_m, shown = self.depth(local, camera)
        rgb = np.stack([40 * (shown + 1) % 256] * 3, axis=-1).astype(np.uint8)
        return PosedView(source, view, seq, seq, floor, T, camera, height, rgb, depth_m, range_m)

    def detect(
        self, view: PosedView, name: str, label: str, score: float, embedding: NDArray[np.float32]
    ) -> DetectedObject | None:
        """A perfect mask of a box, called ``label``."""
        T = view.T_world_camera.copy()
        T[2, 3] = view.mounting_offset_m
        rows, cols = np.nonzero(self.depth(T, view.camera)[1] == list(self.boxes).index(name))
        if len(rows) == 0:
            return None
        y0, y1, x0, x1 = rows.min(), rows.max() + 1, cols.min(), cols.max() + 1
        mask = np.zeros((y1 - y0, x1 - x0), np.bool_)
        mask[rows - y0, cols - x0] = True
        return DetectedObject(label, score, (float(x0), float(y0), float(x1), float(y1)), mask, embedding)


def unit(i: int, dim: int = 8) -> NDArray[np.float32]:
    """The i-th unit vector."""
    return np.eye(dim, dtype=np.float32)[i]


def seen(*detections: DetectedObject | None, image: NDArray[np.float32] | None = None) -> ViewPerception:
    """What perception says."""
    return ViewPerception("test", tuple(d for d in detections if d), unit(7) if image is None else image)
