"""The picture that a worker must answer correctly before it is ready: weights may load and still produce nonsense."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole
from surveilnav.perception.backend import ViewTask
from surveilnav.perception.protocols import RgbdView
from surveilnav.sensing.views import DetectedObject, TrueInstances, ViewPerception, box_cells

PROMPTS: Final = ("chair",)
_CAMERA = Pinhole.from_hfov(320, 240, math.radians(79.0))
_UNIT_TOLERANCE = 0.05  # deviation of a unit vector's length from 1


def probe_task() -> ViewTask:
    """A picture of a colour gradient 2 m away. Backends that are told the truth are told that it shows no instance."""
    y, x = np.mgrid[0 : _CAMERA.height_px, 0 : _CAMERA.width_px]
    rgb = np.stack([x * 255 // _CAMERA.width_px, y * 255 // _CAMERA.height_px, (x + y) % 256], axis=2).astype(np.uint8)
    depth_m = np.full(rgb.shape[:2], 2.0, np.float32)
    nothing = TrueInstances(np.zeros(rgb.shape[:2], np.uint16))
    return ViewTask(RgbdView(rgb, depth_m, _CAMERA), PROMPTS, nothing, ("probe",))


def find_problem(seen: ViewPerception | None, embedding_dim: int) -> str:
    """Checks a backend's answer to the probe picture, and returns in words what is malformed; "" if nothing is.

    A well-formed answer has unit embeddings of ``embedding_dim`` finite numbers, boxes inside the picture, masks of the
    size of their boxes, and scores from 0 to 1.

    Args:
        seen: the answer; None if the backend's last stage gave none, which is a problem, too.
        embedding_dim: the length of embeddings that the backend states.
    """
    if seen is None:
        return "its last stage gave no answer"
    if not _is_unit(seen.image_embedding, embedding_dim):
        return f"expected a unit embedding of {embedding_dim} numbers, got {_describe(seen.image_embedding)}"
    for detected in seen.detections:
        if fault := _detection_problem(detected, embedding_dim):
            return f"its detection {detected.label!r} has {fault}"
    return ""


def find_text_problem(rows: Sequence[NDArray[np.float32]], embedding_dim: int) -> str:
    """What is malformed in embeddings of texts; empty if nothing is."""
    bad = [row for row in rows if not _is_unit(row, embedding_dim)]
    return f"expected unit embeddings of {embedding_dim} numbers for texts, got {_describe(bad[0])}" if bad else ""


def _detection_problem(detected: DetectedObject, embedding_dim: int) -> str:
    x0, y0, x1, y1 = detected.box_px
    if not (0 <= x0 < x1 <= _CAMERA.width_px and 0 <= y0 < y1 <= _CAMERA.height_px):  # False for NaN
        return f"a box outside the picture: {detected.box_px}"
    left, top, right, bottom = box_cells(detected.box_px, _CAMERA.width_px, _CAMERA.height_px)
    if detected.mask is not None and detected.mask.shape != (bottom - top, right - left):
        return f"a mask of {detected.mask.shape} for a box of {(bottom - top, right - left)}"
    if not 0 <= detected.score <= 1:
        return f"a score of {detected.score}"
    if not _is_unit(detected.embedding, embedding_dim):
        return f"no unit embedding but {_describe(detected.embedding)}"
    return ""


def _is_unit(vector: NDArray[np.float32], dim: int) -> bool:
    return vector.shape == (dim,) and abs(float(np.linalg.norm(vector)) - 1.0) < _UNIT_TOLERANCE  # False for NaN


def _describe(vector: NDArray[np.float32]) -> str:
    return f"one of shape {vector.shape} and length {float(np.linalg.norm(vector)):.3g}"
