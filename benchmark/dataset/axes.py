"""Between our world (z up, yaw anticlockwise from +x) and Habitat's (y up, forward is -z, quaternions x y z w)."""

from __future__ import annotations

import math
from collections.abc import Sequence


def to_habitat(p_world: Sequence[float]) -> list[float]:
    """(x, y, z) of our world in Habitat's."""
    x, y, z = p_world
    return [float(x), float(z), -float(y)]


def from_habitat(position: Sequence[float]) -> tuple[float, float, float]:
    """The inverse of ``to_habitat``."""
    x, y, z = position
    return float(x), -float(z), float(y)


def rotation_of(yaw_rad: float) -> list[float]:
    """Habitat's quaternion of a robot that looks along ``yaw_rad``: a turn about +y, from -z as zero."""
    turn = yaw_rad - math.pi / 2  # our +y is Habitat's -z
    return [0.0, math.sin(turn / 2), 0.0, math.cos(turn / 2)]


def yaw_of(rotation: Sequence[float]) -> float:
    """The inverse of ``rotation_of``, in (-pi, pi]."""
    turn = 2.0 * math.atan2(float(rotation[1]), float(rotation[3]))
    return math.remainder(turn + math.pi / 2, 2 * math.pi)
