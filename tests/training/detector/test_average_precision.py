"""AP50 by cases that can be reckoned by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from training.detector.average_precision import ClassTally

BOX = (0.0, 0.0, 10.0, 10.0)
FAR = (100.0, 100.0, 110.0, 110.0)


def tally(*views: tuple[list[tuple[tuple, float]], list[tuple[tuple, bool]]]) -> ClassTally:
    """Of views, each (found boxes with scores, true boxes and whether they count)."""
    out = ClassTally()
    for found, true in views:
        out.add(
            np.array([b for b, _ in found], np.float32).reshape(-1, 4),
            np.array([s for _, s in found], np.float32),
            np.array([b for b, _ in true], np.float32).reshape(-1, 4),
            np.array([c for _, c in true], bool),
        )
    return out


@pytest.mark.parametrize(
    ("views", "ap"),
    [
        ([([(BOX, 0.9)], [(BOX, True)])], 1.0),
        ([([], [(BOX, True)])], 0.0),
        ([([(FAR, 0.9), (BOX, 0.5)], [(BOX, True)])], 0.5),  # the wrong one ranks first
        ([([(BOX, 0.9), (FAR, 0.5)], [(BOX, True)])], 1.0),
        ([([(BOX, 0.9), (BOX, 0.8)], [(BOX, True)])], 1.0),  # the double costs only behind
        ([([(BOX, 0.9)], [(BOX, True), (FAR, True)])], 0.5),
        ([([(FAR, 0.9), (BOX, 0.5)], [(BOX, True), (FAR, False)])], 1.0),  # too small to count either way
        ([([(BOX, 0.4)], [(BOX, True)]), ([(BOX, 0.9)], [])], 0.5),
    ],
)
def test_ap(views: list, ap: float) -> None:
    assert tally(*views).ap == pytest.approx(ap)


def test_without_objects_there_is_none() -> None:
    assert math.isnan(tally(([(BOX, 0.9)], [])).ap)
