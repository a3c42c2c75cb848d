"""The robot's laser scanner: the scan that was taken at about the time of a picture, placed in the building."""

from __future__ import annotations

import math
import threading
from collections import deque
from typing import Any

import numpy as np

from surveilnav.messages.view import ScanHeader
from surveilnav.sensing.scans import encode_scan
from surveilnav.services.robot_node.bodies.ros2.camera import stamp_of
from surveilnav.services.robot_node.bodies.ros2.place import RobotPlace
from surveilnav.services.robot_node.bodies.ros2.transforms import TransformError

#: A scan belongs to a picture if their stamps differ by less. It is placed by its own stamp.
_PAIR_NS = 300_000_000
_KEPT = 10
#: The maps take a scan as level. One that leans by more than this isn't used.
_MAX_TILT_RAD = math.radians(3.0)


class RobotScanner:
    """The newest sensor_msgs/LaserScan messages. Thread-safe. ``note``: why they aren't used, for people; empty if they are."""

    def __init__(self, place: RobotPlace) -> None:
        self._place, self._lock, self.note = place, threading.Lock(), ""
        self._scans: deque[Any] = deque(maxlen=_KEPT)

    def add(self, message: Any) -> None:
        with self._lock:
            self._scans.append(message)

    def scan_at(self, stamp_ns: int) -> ScanHeader | None:
        """The scan nearest in time to a picture. None: there is none near enough, or it isn't known where it was taken."""
        with self._lock:
            nearest = min(self._scans, key=lambda s: abs(stamp_of(s.header) - stamp_ns), default=None)
        if nearest is None or abs(stamp_of(nearest.header) - stamp_ns) > _PAIR_NS:
            return None
        try:
            T_world_scanner = self._place.in_building(nearest.header.frame_id, stamp_of(nearest.header))
        except TransformError:
            return None
        up = float(T_world_scanner[2, 2])  # upside down it turns clockwise
        if abs(up) < math.cos(_MAX_TILT_RAD):
            self.note = (
                f"its laser scanner leans by {math.degrees(math.acos(min(1.0, abs(up)))):.0f} degrees: it isn't used"
            )
            return None
        numbers = nearest.angle_min, nearest.angle_increment, nearest.range_min, nearest.range_max
        if not all(map(math.isfinite, numbers)) or not len(nearest.ranges):
            self.note = "its laser scans have no beams, or directions that aren't finite: they aren't used"
            return None
        self.note = ""
        ranges = np.asarray(nearest.ranges, np.float64)
        ranges = np.where(ranges >= nearest.range_min, ranges, 0.0)  # also of NaN
        ranges = np.where(ranges > nearest.range_max, np.inf, ranges)
        heading = math.atan2(T_world_scanner[1, 0], T_world_scanner[0, 0])
        turn = math.copysign(1.0, up)
        x, y, z = (float(v) for v in T_world_scanner[:3, 3])
        start_rad = math.remainder(heading + turn * nearest.angle_min, 2 * math.pi)
        return encode_scan((x, y, z), start_rad, turn * nearest.angle_increment, ranges, float(nearest.range_max))
