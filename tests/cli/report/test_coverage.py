"""What the views of a camera cover together."""

from __future__ import annotations

import math

import pytest

from surveilnav.cli.report.coverage import coverage


@pytest.mark.parametrize(
    ("azimuths", "expected"),
    [
        (range(0, 360, 30), [(0, 360)]),
        (range(0, 1, 30), [(310, 410)]),
        (range(-30, 120, 30), [(280, 500)]),
        (range(90, 271, 180), [(40, 140), (220, 320)]),
        (range(0), []),
    ],
)
def test_what_a_camera_covers(camera, azimuths, expected):
    sectors = [tuple(math.degrees(a) for a in sector) for sector in coverage(camera("c", 0.0, 0.0, azimuths))]
    assert len(sectors) == len(expected)
    for sector, wanted in zip(sectors, expected, strict=True):
        assert sector == pytest.approx(wanted, abs=1.0)
