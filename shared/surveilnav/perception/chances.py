"""How likely a detection is what it is called: a table for each backend, fitted to views whose truth is known.

A score means something else for every detector, class, size and distance. The chance is a logistic regression on the
score's log-odds and on how large, how far and in what kind of view the thing shows, with a part of its own for each class.
Without a table the score itself is taken for the chance: monotone, and said to be no more than that.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole
from surveilnav.perception.vocabulary import DATA
from surveilnav.sensing.views import DetectedObject, ViewPerception, box_cells

Floats = NDArray[np.float64]

#: Nothing is surer than this, whatever a regression says.
_SUREST = 0.98
#: What the terms are measured from: 0.2 rad is a chair at 3 m.
_SIZE_RAD, _RANGE_M = 0.2, 3.0


class ClassTerms(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a class adds to the terms of all.

    Attributes:
        even: to the log-odds. slope: to the slope of the score's log-odds. n: detections that it was fitted to.
    """

    even: float
    slope: float
    n: int


class ChanceTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Log-odds of being right.

    Attributes:
        source: what it was fitted to, for people.
        even, slope: of all classes, on the score's log-odds.
        size, size_squared: per natural logarithm of the angular size over 0.2 rad.
        range: per natural logarithm of the range over 3 m. camera: in a camera's view.
        by_class: see ``ClassTerms``.
    """

    source: str
    even: float
    slope: float
    size: float
    size_squared: float
    range: float
    camera: float
    by_class: dict[str, ClassTerms]

    def chance(self, label: str, score: float, size_rad: float, range_m: float, *, is_camera: bool) -> float:
        """Of one detection, 0-1; rises with the score.

        Args:
            label: what it is called; score: by its detector.
            size_rad: square root of its box's solid angle. range_m: of the middle of its points; 0: unknown.
            is_camera: whether a camera took the view, not a robot.
        """
        x = features(np.array([score]), np.array([size_rad]), np.array([range_m]), np.array([is_camera]))
        return self.of_features(label, x[0])

    def of_features(self, label: str, x: Floats) -> float:
        """The same of one row (5,) of ``features``."""
        own = self.by_class.get(label)
        slope, even = (self.slope, self.even) if own is None else (self.slope + own.slope, self.even + own.even)
        others = np.array([self.size, self.size_squared, self.range, self.camera])
        logit = even + max(0.0, slope) * float(x[0]) + float(x[1:] @ others)
        return min(_SUREST, max(1.0 - _SUREST, 1.0 / (1.0 + math.exp(-logit))))


def features(score: Floats, size_rad: Floats, range_m: Floats, is_camera: NDArray[np.bool_]) -> Floats:
    """(N, 5) the columns of the regression beside the constant: log-odds of the score, size, its square, range, camera."""
    s = np.clip(np.asarray(score, np.float64), 0.01, 0.99)
    size = np.log(np.clip(size_rad, 0.01, 2.0) / _SIZE_RAD)
    far = np.log(np.clip(np.where(np.asarray(range_m) > 0, range_m, _RANGE_M), 0.3, 20.0) / _RANGE_M)
    return np.column_stack([np.log(s / (1 - s)), size, size**2, far, np.asarray(is_camera, np.float64)])


def with_chances(
    seen: ViewPerception, depth_m: NDArray[np.float32], camera: Pinhole, table: ChanceTable, *, is_camera: bool
) -> ViewPerception:
    """What was seen in a view, with the chance of each detection. ``depth_m``: (height, width) of the view."""
    return replace(seen, detections=tuple(_with_chance(d, depth_m, camera, table, is_camera) for d in seen.detections))


def _with_chance(
    d: DetectedObject, depth_m: NDArray[np.float32], camera: Pinhole, table: ChanceTable, is_camera: bool
) -> DetectedObject:
    x0, y0, x1, y1 = box_cells(d.box_px, camera.width_px, camera.height_px)
    under = depth_m[y0:y1, x0:x1]
    under = under[d.mask] if d.mask is not None else under.ravel()
    under = under[under > 0]
    range_m = float(np.median(under)) if under.size else 0.0
    size = size_rad(d.box_px, camera.fx_px)
    return replace(d, chance=table.chance(d.label, d.score, size, range_m, is_camera=is_camera))


def size_rad(box_px: tuple[float, float, float, float], fx_px: float) -> float:
    """How large a box shows: the square root of its solid angle, as of small boxes in the middle."""
    return math.sqrt(max(0.0, (box_px[2] - box_px[0]) * (box_px[3] - box_px[1]))) / fx_px


@cache
def table_of(backend: str) -> ChanceTable | None:
    """The table of a backend, from ``data/chances/<backend>.json``; None: it has none, and its scores are its chances."""
    path: Path = DATA / "chances" / f"{backend}.json"
    return msgspec.json.decode(path.read_bytes(), type=ChanceTable) if path.exists() else None
