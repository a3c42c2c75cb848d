"""Laser scans on the wire."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from surveilnav.errors import WireError
from surveilnav.messages.view import ScanHeader
from surveilnav.sensing.views import LaserScan

#: Limits of what a scan may claim.
MAX_BEAMS, MAX_RANGE_M = 2048, 60.0
#: A scanner is on the robot, as its camera is.
_MAX_FROM_CAMERA_M = 3.0
_NOTHING = 65535


def encode_scan(
    origin_m: tuple[float, float, float], start_rad: float, step_rad: float, ranges_m: ArrayLike, max_range_m: float
) -> ScanHeader:
    """A scan for the wire. Ranges (N,) [m]: NaN and values that aren't positive are unknown, larger ones than ``max_range_m``
    ended at nothing. Of more than ``MAX_BEAMS`` beams every second one is left out, or more.
    """
    ranges = np.asarray(ranges_m, np.float64)
    every = max(1, math.ceil(len(ranges) / MAX_BEAMS))
    ranges, max_range_m = ranges[::every], min(max_range_m, MAX_RANGE_M)
    with np.errstate(invalid="ignore"):
        ended = (ranges > 0.0) & (ranges <= max_range_m)
        nothing = ranges > max_range_m
    mm = np.where(ended, np.maximum(np.rint(np.where(ended, ranges, 0.0) * 1000.0), 1), np.where(nothing, _NOTHING, 0))
    return ScanHeader(
        origin_m=origin_m,
        start_rad=start_rad,
        step_rad=step_rad * every,
        max_range_m=max_range_m,
        ranges_mm=mm.astype("<u2").tobytes(),
    )


def decode_scan(scan: ScanHeader, p_camera_m: tuple[float, float, float]) -> LaserScan:
    """The scan of a robot whose camera is at ``p_camera_m`` [m, world]. Raises WireError: it makes no sense."""
    n = len(scan.ranges_mm) // 2
    if len(scan.ranges_mm) % 2 or not 0 < n <= MAX_BEAMS:
        raise WireError(f"a scan has 1 to {MAX_BEAMS} beams of two bytes each, got {len(scan.ranges_mm)} bytes")
    if not all(map(math.isfinite, (*scan.origin_m, scan.start_rad, scan.step_rad))):
        raise WireError("a scan's place and directions must be finite")
    if abs(scan.start_rad) > 100.0 or abs(scan.step_rad) * n > 2 * math.pi + 0.1:
        raise WireError(
            f"the beams of a scan go around once, got {n} steps of {scan.step_rad} rad from {scan.start_rad}"
        )
    if not 0.0 < scan.max_range_m <= MAX_RANGE_M:
        raise WireError(f"a scan reaches up to {MAX_RANGE_M:g} m, got {scan.max_range_m}")
    if math.dist(scan.origin_m, p_camera_m) > _MAX_FROM_CAMERA_M:
        raise WireError(f"a scanner is within {_MAX_FROM_CAMERA_M:g} m of its robot's camera, got {scan.origin_m}")
    mm = np.frombuffer(scan.ranges_mm, "<u2")
    nothing = mm == _NOTHING
    ranges_m = np.where(nothing, np.float32(scan.max_range_m), mm.astype(np.float32) / np.float32(1000.0))
    ends = ~nothing & (mm > 0) & (ranges_m <= np.float32(scan.max_range_m))
    return LaserScan(scan.origin_m, scan.start_rad, scan.step_rad, ranges_m.astype(np.float32), ends)
