"""What a robot's stops leave open about the cameras, and which stops would close it.

The derivatives of the sightings have singular values of zero where a combination of unknowns changes no picture
(tests/shared/camera_pose/tag/test_model.py counts them):

- cameras and tag all higher by the same length: always, so the tag's height has to be told;
- all stops in one direction: the tag shifted on the robot, and the cameras the other way (2);
- all stops at one place: tag and cameras turned about it (1);
- all stops on one line and in one direction: besides the shift, everything turned about the line (3).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_MIN_TURN_RAD = math.radians(20.0)
_MIN_EXTENT_M = 0.5
_MIN_WIDTH_M = 0.3


def fault_of_stops(own: NDArray[np.float64], every: NDArray[np.float64]) -> str:
    """What is missing where a camera's pose stays uncertain.

    Args:
        own: (n, 3) x [m], y [m] and yaw [rad] of the stops at which the camera saw the tag.
        every: (m, 3), of the stops of all cameras, which tell where the tag sits.
    """
    if _turn_rad(every[:, 2]) < _MIN_TURN_RAD:
        return (
            "the robot never turned, so nothing tells where on the robot the tag sits: stop in several directions, "
            "30 degrees apart or more"
        )
    length_m, width_m = _extents_m(own[:, :2])
    if length_m < _MIN_EXTENT_M:
        return f"all stops at which it saw the tag lie within {length_m:.1f} m: drive around in its view"
    if width_m < _MIN_WIDTH_M:
        return "all stops at which it saw the tag lie on one line: stop to both sides of it, too"
    return "stop at more places, nearer to the camera, and spread over its whole view"


def _turn_rad(yaw_rad: NDArray[np.float64]) -> float:
    """The angle between the two directions that are farthest apart."""
    apart = np.abs(yaw_rad[:, None] - yaw_rad[None]) % (2 * math.pi)
    return float(np.minimum(apart, 2 * math.pi - apart).max())


def _extents_m(xy: NDArray[np.float64]) -> tuple[float, float]:
    """Length of the stops along the direction in which they spread farthest, and width across it."""
    centred = xy - xy.mean(axis=0)
    along = centred @ np.linalg.svd(centred)[2].T
    length, width = np.ptp(along, axis=0)
    return float(length), float(width)
