"""What the views of a camera cover, as azimuths."""

from __future__ import annotations

import math

import numpy as np

from surveilnav.messages import CameraInfo, CameraViewInfo

#: Azimuths [rad] from, to; anticlockwise.
Sector = tuple[float, float]


def coverage(info: CameraInfo) -> list[Sector]:
    """The azimuths that the views of a camera cover together; [(0, 2 pi)] for a panorama, [] if all look down."""
    n = 720
    azimuths = (np.arange(n) + 0.5) * math.tau / n
    covered = np.zeros(n, bool)
    for view in info.views:
        if (yaw := azimuth(view)) is not None:
            apart = (azimuths - yaw + math.pi) % math.tau - math.pi
            covered |= np.abs(apart) <= info.intrinsics.hfov_rad / 2
    if covered.all():
        return [(0.0, math.tau)]
    starts = np.nonzero(covered & ~np.roll(covered, 1))[0]
    ends = np.nonzero(covered & ~np.roll(covered, -1))[0] + 1
    if len(starts) and ends[0] <= starts[0]:  # the first run began before azimuth 0
        ends = np.roll(ends, -1)
    return [
        (a * math.tau / n, (b if b > a else b + n) * math.tau / n)
        for a, b in zip(starts.tolist(), ends.tolist(), strict=True)
    ]


def azimuth(view: CameraViewInfo) -> float | None:
    """Where a view looks [rad, anticlockwise from +x]; None if (nearly) straight down or up."""
    axis = view.T_world_camera.matrix()[:3, 2]
    return math.atan2(axis[1], axis[0]) if math.hypot(axis[0], axis[1]) > 0.3 else None
