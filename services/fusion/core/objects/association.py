"""Is this detection that object? Geometric and semantic similarity, and their weighted sum (eq. 3)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.services.fusion.core.config import AssociationConfig
from surveilnav.services.fusion.core.objects.shape import Keys, Shape, found_in


class Similarity(NamedTuple):
    """Of two things.

    Attributes:
        s: eq. 3's weighted sum.
        mutual: the smaller of both overlaps; 1 if each lies in the other.
    """

    s: float
    mutual: float


def similarity(
    shape: Shape,
    embedding: NDArray[np.float32],
    other: Shape,
    other_embedding: NDArray[np.float32],
    config: AssociationConfig,
    *,
    comparable: bool = True,
) -> Similarity:
    """Eq. 3: ``s = w_1 S_vis + w_2 S_geo``, of the cosine of embeddings (D,) and what ``config.geometry`` says of shapes.

    ``comparable``: both embeddings come from one model; else geometry has the weight of both.
    """
    s_vis = config.w_visual * cosine(embedding, other_embedding) if comparable else 0.0
    w_geometric = config.w_geometric + (0.0 if comparable else config.w_visual)
    if apart(shape, other, 2 * config.overlap_voxel_m):
        return Similarity(s_vis, 0.0)
    there, back = overlaps(shape, other)
    if config.geometry == "box_iou":
        s_geo = box_iou(shape, other)
    elif config.geometry == "voxel_iou":
        s_geo = voxel_iou(shape, other)
    else:
        s_geo = max(there, back)
    return Similarity(s_vis + w_geometric * s_geo, min(there, back))


def same_place(mutual: float, config: AssociationConfig) -> bool:
    """Whether two things overlap both ways so much that they are one, whatever their looks."""
    return config.tau_mutual is not None and mutual >= config.tau_mutual


def apart(a: Shape, b: Shape, margin_m: float) -> bool:
    """Whether the boxes are farther than ``margin_m`` from each other along some axis: then nothing overlaps."""
    return bool(np.any(a.p_min > b.p_max + margin_m) or np.any(b.p_min > a.p_max + margin_m))


def box_overlap(a: Shape, b: Shape) -> float:
    """Share of the smaller axis-aligned box that lies in the other: front and back of one thing share no points."""
    inside = np.prod(np.clip(np.minimum(a.p_max, b.p_max) - np.maximum(a.p_min, b.p_min), 0.0, None))
    return float(inside / min(np.prod(a.p_max - a.p_min), np.prod(b.p_max - b.p_min)))


def box_iou(a: Shape, b: Shape) -> float:
    """Intersection over union of the axis-aligned boxes: what VLN-Game's 1.35 was tuned with."""
    inside = np.prod(np.clip(np.minimum(a.p_max, b.p_max) - np.maximum(a.p_min, b.p_min), 0.0, None))
    both = np.prod(a.p_max - a.p_min) + np.prod(b.p_max - b.p_min) - inside
    return float(inside / both)


def voxel_iou(a: Shape, b: Shape) -> float:
    """Intersection over union of the fine voxels: the paper's words."""
    inside = _shared(a.keys, b.keys)
    return inside / (len(a.keys) + len(b.keys) - inside)


def overlaps(a: Shape, b: Shape) -> tuple[float, float]:
    """Share of a's coarse voxels with one of b's beside them, and the reverse: ConceptGraphs' ratio, both ways."""
    return _beside(a.coarse, b.coarse) / len(a.coarse), _beside(b.coarse, a.coarse) / len(b.coarse)


def cosine(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    """Cosine similarity; 0 where the vectors are of different length or are nothing."""
    if a.shape != b.shape:
        return 0.0
    length = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / length if length > 0 else 0.0


def _shared(a: Keys, b: Keys) -> int:
    """How many elements of a lie in b; both sorted and unique."""
    return int(np.count_nonzero(found_in(a, b)))


@njit(cache=True, nogil=True)
def _beside(a, b):  # type: ignore[no-untyped-def]
    """How many voxels of a have one of b among the 27 at and around them; both sorted and unique."""
    n = 0
    for key in a:
        found = False
        for z in (0, -1, 1):
            for y in (0, -1, 1):
                low = key + z * (np.int64(1) << 42) + y * (np.int64(1) << 21) - 1
                i = np.searchsorted(b, low)  # three neighbours along x are three keys in a row
                if i < len(b) and b[i] <= low + 2:
                    found = True
                    break
            if found:
                break
        n += found
    return n
