"""Calibration of scores: the probability that a detection is what it is called.

A detector's score of 0.6 means something else for each detector, class, size and distance. The probability ("chance") is a
logistic regression on the score's log-odds and on the object's size, range and kind of view, with terms for each class. Each
calibrated backend has a table of coefficients, fitted to views whose truth is known (``benchmark/studies/calibration``).
Without a table the score itself takes the place of the probability.
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

#: Upper limit of a probability; 1 - it is the lower one.
_MAX_CHANCE = 0.98
#: Size and range at which their terms are zero. A chair at 3 m has a size of 0.2 rad.
_SIZE_RAD, _RANGE_M = 0.2, 3.0


class ClassTerms(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Terms that a class adds to those of all classes.

    Attributes:
        intercept: added to the log-odds.
        slope: added to the slope of the score's log-odds.
        n: number of detections that the terms were fitted to.
    """

    intercept: float
    slope: float
    n: int


class ChanceTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Coefficients of the regression for the log-odds of being right.

    Attributes:
        source: what it was fitted to, for people.
        intercept, slope: for all classes; the slope is on the score's log-odds.
        size, size_squared: on the natural logarithm of the angular size over 0.2 rad, and on its square.
        range: on the natural logarithm of the range over 3 m.
        camera: added in views of surveillance cameras.
        by_class: by class, its own terms.
    """

    source: str
    intercept: float
    slope: float
    size: float
    size_squared: float
    range: float
    camera: float
    by_class: dict[str, ClassTerms]

    def chance(self, label: str, score: float, size_rad: float, range_m: float, *, is_camera: bool) -> float:
        """The probability that a detection is right, 0-1. It never falls when the score rises.

        Args:
            size_rad: square root of the solid angle of its box.
            range_m: median range of its points; 0: unknown.
            is_camera: whether a surveillance camera took the view, not a robot.
        """
        x = features(np.array([score]), np.array([size_rad]), np.array([range_m]), np.array([is_camera]))
        return self.chance_from_features(label, x[0])

    def chance_from_features(self, label: str, x: Floats) -> float:
        """``chance`` for one row (5,) of ``features``."""
        own = self.by_class.get(label)
        slope, intercept = self.slope, self.intercept
        if own is not None:
            slope, intercept = slope + own.slope, intercept + own.intercept
        others = np.array([self.size, self.size_squared, self.range, self.camera])
        logit = intercept + max(0.0, slope) * float(x[0]) + float(x[1:] @ others)
        return min(_MAX_CHANCE, max(1.0 - _MAX_CHANCE, 1.0 / (1.0 + math.exp(-logit))))


def features(score: Floats, size_rad: Floats, range_m: Floats, is_camera: NDArray[np.bool_]) -> Floats:
    """(N, 5) columns of the regression: log-odds of the score, log size, its square, log range, camera."""
    s = np.clip(np.asarray(score, np.float64), 0.01, 0.99)
    size = np.log(np.clip(size_rad, 0.01, 2.0) / _SIZE_RAD)
    far = np.log(np.clip(np.where(np.asarray(range_m) > 0, range_m, _RANGE_M), 0.3, 20.0) / _RANGE_M)
    return np.column_stack([np.log(s / (1 - s)), size, size**2, far, np.asarray(is_camera, np.float64)])


def with_chances(
    seen: ViewPerception, depth_m: NDArray[np.float32], camera: Pinhole, table: ChanceTable, *, is_camera: bool
) -> ViewPerception:
    """The detections of a view with their calibrated probabilities. ``depth_m``: (height, width) of the view."""
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
    """Angular size of a box: the square root of its solid angle, approximated as for a small box in the picture's centre."""
    return math.sqrt(max(0.0, (box_px[2] - box_px[0]) * (box_px[3] - box_px[1]))) / fx_px


@cache
def chance_table(backend: str) -> ChanceTable | None:
    """The table of a backend, from ``data/chances/<backend>.json``; None if it isn't calibrated."""
    path: Path = DATA / "chances" / f"{backend}.json"
    return msgspec.json.decode(path.read_bytes(), type=ChanceTable) if path.exists() else None
