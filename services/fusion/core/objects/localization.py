"""Where a detection stands in the world: its mask back-projected, without the background that leaked in.

The paper's section IV-D.1; clusters of DBSCAN as its section V-A says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from surveilnav.geometry import transform_points
from surveilnav.sensing.views import DetectedObject, PosedView, box_cells
from surveilnav.services.fusion.core.config import ObjectConfig
from surveilnav.services.fusion.core.objects.clustering import largest_cluster
from surveilnav.services.fusion.core.objects.shape import Shape


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """A detection with its place in the world.

    ``range_m``: median distance of its points from the camera. ``embedding_model``: of the detection's embedding.
    """

    detected: DetectedObject
    shape: Shape
    range_m: float
    embedding_model: str = ""


def locate_all(
    view: PosedView,
    detections: tuple[DetectedObject, ...],
    voxel_m: float,
    config: ObjectConfig,
    embedding_model: str = "",
) -> list[Sighting]:
    """The detections of a view that have a place, strongest first: a weaker double finds its object taken."""
    strongest_first = sorted(detections, key=lambda d: (-d.score, d.label, d.box_px))
    return [s for d in strongest_first if (s := locate(view, d, voxel_m, config, embedding_model))]


def locate(
    view: PosedView, detected: DetectedObject, voxel_m: float, config: ObjectConfig, embedding_model: str = ""
) -> Sighting | None:
    """Back-projects a mask and keeps the largest DBSCAN cluster; None if too little is left of it."""
    c, camera = config.points, view.camera
    if detected.score < c.min_score:
        return None
    x0, y0, x1, y1 = box_cells(detected.box_px, camera.width_px, camera.height_px)
    if x1 <= x0 or y1 <= y0:
        return None
    stride = max(1, math.ceil(math.sqrt((x1 - x0) * (y1 - y0) / c.max_points)))
    if detected.mask is not None:  # a thin mask may fill little of its box
        stride = max(1, math.ceil(math.sqrt(np.count_nonzero(detected.mask) / c.max_points)))
    depth_m = view.depth_m[y0:y1:stride, x0:x1:stride]
    near_m, far_m = view.depth_range_m
    far_m = min(far_m, c.max_range_robot_m if view.is_robot else c.max_range_camera_m)
    with np.errstate(invalid="ignore"):
        good = (depth_m > 0) & (depth_m >= near_m) & (depth_m < far_m)
    if detected.mask is not None:
        good &= detected.mask[::stride, ::stride]
    v, u = np.nonzero(good)
    if len(v) < c.min_points:
        return None
    z = depth_m[v, u]
    p_camera = camera.rays()[y0:y1:stride, x0:x1:stride][v, u] * z[:, None]
    spacing_m = stride * float(np.median(z)) / camera.fx_px  # far off, samples lie farther apart than eps
    kept = largest_cluster(p_camera, max(c.dbscan_eps_m, c.dbscan_eps_pixels * spacing_m), c.dbscan_min_points)
    if len(kept) < c.min_points:
        return None
    p_world = transform_points(view.T_world_camera, p_camera[kept].astype(np.float64))
    range_m = float(np.median(np.linalg.norm(p_camera[kept], axis=1)))
    shape = Shape.of_points(p_world, voxel_m, config.association.overlap_voxel_m)
    return Sighting(detected, shape, range_m, embedding_model)
