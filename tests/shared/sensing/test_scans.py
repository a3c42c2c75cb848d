"""Laser scans on the wire: what is said arrives, and what can't be is refused."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from surveilnav.errors import WireError
from surveilnav.messages.view import ScanHeader
from surveilnav.sensing.scans import MAX_BEAMS, decode_scan, encode_scan

HERE = (1.0, 2.0, 0.9)


def test_ranges_arrive_to_the_millimetre_with_what_they_ended_at():
    header = encode_scan((1.0, 2.0, 0.2), 0.5, 0.1, [1.2345, math.nan, math.inf, 0.0, -1.0, 12.0, 0.0001], 10.0)
    header = msgspec.msgpack.decode(msgspec.msgpack.encode(header), type=ScanHeader)
    scan = decode_scan(header, HERE)
    np.testing.assert_allclose(scan.ranges_m, [1.234, 0.0, 10.0, 0.0, 0.0, 10.0, 0.001], atol=6e-4)
    assert scan.ends.tolist() == [True, False, False, False, False, False, True]
    assert (scan.origin_m, scan.start_rad, scan.step_rad) == ((1.0, 2.0, 0.2), 0.5, 0.1)


def test_of_too_many_beams_some_are_left_out():
    ranges = np.linspace(1.0, 2.0, 3 * MAX_BEAMS)
    header = encode_scan((1.0, 2.0, 0.2), 0.0, 2 * math.pi / len(ranges), ranges, 10.0)
    scan = decode_scan(header, HERE)
    assert len(scan.ranges_m) <= MAX_BEAMS
    i = len(scan.ranges_m) // 2
    at = (i * scan.step_rad) / (2 * math.pi) * len(ranges)
    assert scan.ranges_m[i] == pytest.approx(ranges[round(at)], abs=1e-3)


@pytest.mark.parametrize(
    "wrong",
    [
        {"ranges_mm": b""},
        {"ranges_mm": b"123"},
        {"ranges_mm": bytes(2 * MAX_BEAMS + 2)},
        {"origin_m": (math.nan, 0.0, 0.0)},
        {"origin_m": (1.0, 2.0, 1e300)},
        {"origin_m": (30.0, 2.0, 0.2)},
        {"start_rad": math.inf},
        {"start_rad": 1e9},
        {"step_rad": math.nan},
        {"step_rad": 3.0},
        {"max_range_m": 0.0},
        {"max_range_m": 1e9},
        {"max_range_m": math.nan},
    ],
)
def test_what_cannot_be_is_refused(wrong):
    good = encode_scan((1.0, 2.0, 0.2), 0.0, 0.1, [1.0, 2.0, 3.0], 10.0)
    decode_scan(good, HERE)
    with pytest.raises(WireError):
        decode_scan(msgspec.structs.replace(good, **wrong), HERE)
