"""Association (eq. 3): geometric and semantic similarity of a detection and an object, and their weighted sum."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.services.fusion.core.objects.config import AssociationConfig
from surveilnav.services.fusion.core.objects.shape import Shape, found_in


class Similarity(NamedTuple):
    """How similar two things (detections or objects) are.

    Attributes:
        s: the weighted sum of eq. 3.
        mutual_overlap: the smaller of the overlaps in both directions (``overlaps``); 1 if each lies within the other.
    """

    s: float
    mutual_overlap: float


def similarity(
    shape: Shape,
    embedding: NDArray[np.float32],
    other: Shape,
    other_embedding: NDArray[np.float32],
    config: AssociationConfig,
    *,
    comparable: bool = True,
) -> Similarity:
    """Eq. 3, ``s = w_1 S_vis + w_2 S_geo``.

    S_vis is the cosine of the embeddings (D,), S_geo the similarity of the shapes that ``config.geometry`` selects.

    Args:
        comparable: whether both embeddings come from the same model. If not, geometry gets the weight of both terms.
    """
    s_vis = config.w_visual * cosine(embedding, other_embedding) if comparable else 0.0
    w_geometric = config.w_geometric + (0.0 if comparable else config.w_visual)
    if are_apart(shape, other, 2 * config.overlap_voxel_m):
        return Similarity(s_vis, 0.0)
    forward, backward = overlaps(shape, other)
    if config.geometry == "box_iou":
        s_geo = box_iou(shape, other)
    elif config.geometry == "voxel_iou":
        s_geo = voxel_iou(shape, other)
    else:
        s_geo = max(forward, backward)
    return Similarity(s_vis + w_geometric * s_geo, min(forward, backward))


def gate_distance(
    a: Shape, covariance_a_m2: NDArray[np.float64] | None, b: Shape, covariance_b_m2: NDArray[np.float64] | None
) -> float:
    """How many standard deviations the gap between two things is wide, if the place of at least one is an estimate (Mahalanobis).

    The gap is what separates their boxes horizontally; things that overlap have none.
    """
    gap_m = np.maximum(0.0, np.maximum(a.p_min - b.p_max, b.p_min - a.p_max))[:2]
    if not gap_m.any():
        return 0.0
    total_m2 = sum((c for c in (covariance_a_m2, covariance_b_m2) if c is not None), np.zeros((2, 2)))
    towards = np.sign(b.centre_m - a.centre_m)[:2] * gap_m
    return math.sqrt(float(towards @ np.linalg.solve(total_m2, towards)))


def is_same_place(mutual_overlap: float, config: AssociationConfig) -> bool:
    """Whether two things overlap so much in both directions that they are one, however different they look."""
    return config.tau_mutual is not None and mutual_overlap >= config.tau_mutual


def are_apart(a: Shape, b: Shape, margin_m: float) -> bool:
    """Whether the boxes are farther than ``margin_m`` from each other along some axis, so that nothing can overlap."""
    return bool(np.any(a.p_min > b.p_max + margin_m) or np.any(b.p_min > a.p_max + margin_m))


def box_overlap(a: Shape, b: Shape) -> float:
    """The share of the smaller axis-aligned box that lies inside the other.

    It also matches the front and the back of one thing, which have no points in common.
    """
    return _box_intersection_m3(a, b) / float(min(np.prod(a.p_max - a.p_min), np.prod(b.p_max - b.p_min)))


def box_iou(a: Shape, b: Shape) -> float:
    """Intersection over union of the axis-aligned boxes, for which VLN-Game tuned its threshold of 1.35."""
    inside = _box_intersection_m3(a, b)
    return inside / (float(np.prod(a.p_max - a.p_min) + np.prod(b.p_max - b.p_min)) - inside)


def voxel_iou(a: Shape, b: Shape) -> float:
    """Intersection over union of the fine voxels, which is how the paper defines S_geo."""
    inside = int(np.count_nonzero(found_in(a.keys, b.keys)))
    return inside / (len(a.keys) + len(b.keys) - inside)


def overlaps(a: Shape, b: Shape) -> tuple[float, float]:
    """ConceptGraphs' overlap ratio in both directions: the share of a's coarse voxels next to one of b's, and the reverse."""
    return (
        _count_with_neighbour(a.coarse, b.coarse) / len(a.coarse),
        _count_with_neighbour(b.coarse, a.coarse) / len(b.coarse),
    )


def cosine(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    """Cosine similarity of two vectors; 0 if their lengths differ or one of them is zero."""
    if a.shape != b.shape:
        return 0.0
    length = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / length if length > 0 else 0.0


def _box_intersection_m3(a: Shape, b: Shape) -> float:
    return float(np.prod(np.clip(np.minimum(a.p_max, b.p_max) - np.maximum(a.p_min, b.p_min), 0.0, None)))


@njit(cache=True, nogil=True)
def _count_with_neighbour(a, b):  # type: ignore[no-untyped-def]
    """The number of voxels of a with one of b among the 27 at and around them; both are sorted and unique."""
    n = 0
    for key in a:
        found = False
        for z in (0, -1, 1):
            for y in (0, -1, 1):
                low = key + z * (np.int64(1) << 42) + y * (np.int64(1) << 21) - 1
                i = np.searchsorted(b, low)  # three neighbours along x have three consecutive keys
                if i < len(b) and b[i] <= low + 2:
                    found = True
                    break
            if found:
                break
        n += found
    return n
