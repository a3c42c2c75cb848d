"""Locates detections in the world: back-projects their masks and removes the background that leaked in.

The paper's section IV-D.1; the clustering is DBSCAN, as in its section V-A.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import transform_points
from surveilnav.sensing.views import DetectedObject, PosedView, box_cells
from surveilnav.services.fusion.core.objects.clustering import largest_cluster
from surveilnav.services.fusion.core.objects.config import ObjectConfig, PointsConfig
from surveilnav.services.fusion.core.objects.foot_point import EstimatedPlace, locate_by_foot
from surveilnav.services.fusion.core.objects.shape import Shape


@dataclass(frozen=True, slots=True, eq=False)
class LocatedDetection:
    """A detection and its place in the world.

    Attributes:
        shape: its points as voxels.
        range_m: median distance of its points from the camera.
        covariance_m2: (2, 2) of its horizontal position if that was estimated; None if a sensor measured its depth.
    """

    detection: DetectedObject
    shape: Shape
    range_m: float
    embedding_model: str = ""
    covariance_m2: NDArray[np.float64] | None = None


def locate_all(
    view: PosedView,
    detections: tuple[DetectedObject, ...],
    floor_z_m: float,
    voxel_m: float,
    config: ObjectConfig,
    embedding_model: str = "",
) -> list[LocatedDetection]:
    """Locates the detections of a view, the strongest first, so that a weaker duplicate finds its object already taken.

    Detections that can't be located are left out. So is what lies below the floor at ``floor_z_m`` [m, world]: it was seen down a
    stairwell or from a gallery, and no way on this floor leads to it. Whoever is on its own floor will see it there.
    """
    strongest_first = sorted(detections, key=lambda d: (-d.score, d.label, d.box_px))
    located = (locate(view, d, voxel_m, config, embedding_model) for d in strongest_first)
    lowest_z_m = floor_z_m - config.points.below_floor_m
    return [found for found in located if found is not None and found.shape.p_max[2] >= lowest_z_m]


def locate(
    view: PosedView, detection: DetectedObject, voxel_m: float, config: ObjectConfig, embedding_model: str = ""
) -> LocatedDetection | None:
    """Back-projects the mask of a detection and keeps its largest cluster; None if too few points are left.

    In a view without a depth sensor the detection is located by its foot or by estimated depth, whichever is more certain.
    """
    c = config.points
    if detection.score < c.min_score:
        return None
    if view.depth_source == "sensor":
        if (points := _cluster(view, detection, c)) is None:
            return None
        shape = Shape.from_points(points.p_world, voxel_m, config.association.overlap_voxel_m)
        return LocatedDetection(detection, shape, points.range_m, embedding_model)
    estimates = [locate_by_foot(view, detection, view.floor_z_m, config.foot_point)]
    if view.depth_source != "none":
        estimates.append(_locate_by_estimated_depth(view, detection, config))
    estimate = min(filter(None, estimates), key=lambda e: float(np.trace(e.covariance_m2)), default=None)
    if estimate is None:
        return None
    shape = Shape.from_points(estimate.p_world, voxel_m, config.association.overlap_voxel_m)
    return LocatedDetection(detection, shape, estimate.range_m, embedding_model, estimate.covariance_m2)


@dataclass(frozen=True, slots=True, eq=False)
class _Cluster:
    """The largest cluster of a mask's points: (N, 3) [m, world], and its median distance from the camera [m]."""

    p_world: NDArray[np.floating]
    range_m: float


def _cluster(view: PosedView, detection: DetectedObject, c: PointsConfig) -> _Cluster | None:
    """The largest cluster of the points of a mask; None if it is too small."""
    p_camera, spacing_m = _mask_points(view, detection, c)
    if len(p_camera) < c.min_points:
        return None
    # far from the camera, neighbouring samples are farther apart than the paper's fixed eps
    kept = largest_cluster(p_camera, max(c.dbscan_eps_m, c.dbscan_eps_pixels * spacing_m), c.dbscan_min_points)
    if len(kept) < c.min_points:
        return None
    p_world = transform_points(view.T_world_camera, p_camera[kept].astype(np.float64))
    return _Cluster(p_world, float(np.median(np.linalg.norm(p_camera[kept], axis=1))))


def _locate_by_estimated_depth(
    view: PosedView, detection: DetectedObject, config: ObjectConfig
) -> EstimatedPlace | None:
    """Locates a detection by depth that was estimated: along the ray it is as uncertain as that depth."""
    points = _cluster(view, detection, config.points)
    if points is None:
        return None
    p_camera = view.T_world_camera[:2, 3]
    away = np.median(points.p_world[:, :2], axis=0) - p_camera
    horizontal_m = float(np.linalg.norm(away))
    along_m = view.depth_uncertainty.sigma * points.range_m
    if horizontal_m < 1e-3 or along_m > config.foot_point.max_sigma_m:
        return None
    return EstimatedPlace.along_ray(points.p_world, away / horizontal_m, along_m, horizontal_m, config.foot_point)


def _mask_points(view: PosedView, detection: DetectedObject, c: PointsConfig) -> tuple[NDArray[np.float32], float]:
    """Back-projects about ``max_points`` pixels of a mask that have a depth within range.

    Returns:
        Points (N, 3) [m, camera], and the distance between neighbouring ones [m] at their median depth.
    """
    camera = view.camera
    x0, y0, x1, y1 = box_cells(detection.box_px, camera.width_px, camera.height_px)
    if x1 <= x0 or y1 <= y0:
        return np.empty((0, 3), np.float32), 0.0
    stride = max(1, math.ceil(math.sqrt((x1 - x0) * (y1 - y0) / c.max_points)))
    if detection.mask is not None:  # a thin mask may fill little of its box
        stride = max(1, math.ceil(math.sqrt(np.count_nonzero(detection.mask) / c.max_points)))
    depth_m = view.depth_m[y0:y1:stride, x0:x1:stride]
    near_m, far_m = view.depth_range_m
    far_m = min(far_m, c.max_range_robot_m if view.is_robot else c.max_range_camera_m)
    with np.errstate(invalid="ignore"):
        chosen = (depth_m > 0) & (depth_m >= near_m) & (depth_m < far_m)
    if detection.mask is not None:
        chosen &= detection.mask[::stride, ::stride]
    v, u = np.nonzero(chosen)
    if len(v) == 0:
        return np.empty((0, 3), np.float32), 0.0
    z_m = depth_m[v, u]
    p_camera = camera.rays()[y0:y1:stride, x0:x1:stride][v, u] * z_m[:, None]
    return p_camera, stride * float(np.median(z_m)) / camera.fx_px
