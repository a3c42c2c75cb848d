"""How much of a view a camera sends: its tiers, and how each is encoded.

- ``raw``: the picture without loss (PNG), depth in steps of 0.0001/m.
- ``jpeg+depth``: the picture as JPEG, depth of every pixel in steps of 0.001/m.
- ``jpeg``: the picture as JPEG, no depth.
- ``features``: what the camera's own perception saw, with masks and depth in cells of 8 pixels a side (0.006/m), and the picture
  64 pixels wide, for the colours of the point cloud.
- ``objects``: the same without masks, and with depth in cells of 16 pixels a side, at likely objects alone. Nobody learns
  of free floor from it.

In ``features`` and ``objects`` nobody but the camera itself can look at a view. Everything is decoded to a ``PosedView`` of the
camera's full resolution (``packing.decode_frame``), so that nothing else knows of tiers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole
from surveilnav.messages import ModelIds, PayloadPart, Tier
from surveilnav.sensing.depth_codec import encode_depth, finest_quantum_per_m
from surveilnav.sensing.packing import encode_jpeg, encode_png, encode_rgbd
from surveilnav.sensing.perceived import perceived_to_bytes
from surveilnav.sensing.views import DetectedObject, ViewPerception, box_cells


class _Reduction(NamedTuple):
    """What remains of a view in a tier with perception."""

    picture_px: int
    picture_quality: int
    depth_divisor: int
    mask_divisor: int
    quantum_per_m: float
    free_space: bool
    lowest_confidence: float


_RAW_QUANTUM_PER_M: Final = 0.0001
_REDUCED: Final[dict[Tier, _Reduction]] = {
    "features": _Reduction(64, 25, 8, 8, 0.006, free_space=True, lowest_confidence=0.0),
    "objects": _Reduction(32, 20, 16, 16, 0.006, free_space=False, lowest_confidence=0.2),
}


@dataclass(frozen=True, slots=True)
class EncodedView:
    """A view's payload and its parts, as in ``FrameHeader``. ``has_depth``: whether any pixel may have depth."""

    payload: bytes
    image: PayloadPart
    depth: PayloadPart
    has_depth: bool = True
    perceived: PayloadPart | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What perception saw in a view, and by which models."""

    perception: ViewPerception
    models: ModelIds


def encode_view(
    tier: Tier,
    rgb: NDArray[np.uint8],
    depth_m: NDArray[np.float32],
    camera: Pinhole,
    *,
    depth_range_m: tuple[float, float],
    jpeg_quality: int = 85,
    seen: Seen | None = None,
) -> EncodedView:
    """Encodes a view as a tier has it.

    Args:
        rgb: (height, width, 3) uint8. ``depth_m``: (height, width) [m], 0 or NaN where there is none.
        depth_range_m: (nearest, farthest) depth, as in the header.
        jpeg_quality: of ``jpeg+depth`` and ``jpeg``.
        seen: what the camera's own perception saw, for ``features`` and ``objects``; None: it can't read this view.

    Raises:
        ValueError: an array isn't a picture.
    """
    if tier in _REDUCED:
        return _reduced(_REDUCED[tier], rgb, depth_m, camera, depth_range_m, seen)
    if tier != "raw":
        known_m = np.zeros_like(depth_m) if tier == "jpeg" else depth_m
        payload, image, depth = encode_rgbd(rgb, known_m, depth_range_m=depth_range_m, jpeg_quality=jpeg_quality)
        return EncodedView(payload, image, depth, has_depth=tier != "jpeg")
    quantum = max(_RAW_QUANTUM_PER_M, finest_quantum_per_m(depth_range_m[0]))
    png, inverse = encode_png(rgb), encode_depth(depth_m, depth_range_m, quantum_per_m=quantum)
    depth = PayloadPart("depth-invq-zstd", len(inverse), quantum_per_m=quantum)
    return EncodedView(png + inverse, PayloadPart("png", len(png)), depth)


def _reduced(
    reduction: _Reduction,
    rgb: NDArray[np.uint8],
    depth_m: NDArray[np.float32],
    camera: Pinhole,
    depth_range_m: tuple[float, float],
    seen: Seen | None,
) -> EncodedView:
    found = seen.perception.detections if seen is not None else ()
    found = tuple(d for d in found if d.confidence >= reduction.lowest_confidence)
    if not reduction.free_space:
        depth_m = np.where(_covered(found, camera), depth_m, np.float32(0.0))
    quantum = max(reduction.quantum_per_m, finest_quantum_per_m(depth_range_m[0]))
    depth = encode_depth(depth_m, depth_range_m, divisor=reduction.depth_divisor, quantum_per_m=quantum)
    width = min(reduction.picture_px, rgb.shape[1])
    size = width, max(1, round(width * rgb.shape[0] / rgb.shape[1]))
    image = encode_jpeg(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), reduction.picture_quality)
    perceived, part = b"", None
    if seen is not None:
        perceived = perceived_to_bytes(
            replace(seen.perception, detections=found),
            seen.models,
            camera,
            divisor=reduction.mask_divisor,
            masks=reduction.free_space,
        )
        part = PayloadPart("perceived-zstd", len(perceived), reduction.mask_divisor)
    return EncodedView(
        image + depth + perceived,
        PayloadPart("jpeg", len(image)),
        PayloadPart("depth-invq-zstd", len(depth), reduction.depth_divisor, quantum),
        has_depth=reduction.free_space or bool(found),
        perceived=part,
    )


def _covered(detections: Sequence[DetectedObject], camera: Pinhole) -> NDArray[np.bool_]:
    """The pixels (height, width) that a detection covers."""
    covered = np.zeros((camera.height_px, camera.width_px), np.bool_)
    for found in detections:
        x0, y0, x1, y1 = box_cells(found.box_px, camera.width_px, camera.height_px)
        covered[y0:y1, x0:x1] |= True if found.mask is None else found.mask
    return covered
