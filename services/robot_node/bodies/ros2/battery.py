"""How full the robot's battery is."""

from __future__ import annotations

import math
import time
from typing import Any

#: What was said longer ago doesn't count. Drivers publish every second to every minute.
_MAX_AGE_S = 300.0


class Battery:
    """The newest sensor_msgs/BatteryState that says something."""

    def __init__(self) -> None:
        self._share, self._told_s, self._is_percent = 0.0, -math.inf, False

    def add(self, message: Any) -> None:
        """Takes a message. Some drivers give percent instead of the 0 to 1 that its definition asks for; one that did so once
        always does. Anything else, NaN among it, says nothing.
        """
        share = float(message.percentage)
        self._is_percent |= 1.0 < share <= 100.0
        if self._is_percent:
            share /= 100.0
        if 0.0 <= share <= 1.0:
            self._share, self._told_s = share, time.monotonic()

    @property
    def share(self) -> float | None:
        """How full it is, 0 to 1; None: nothing was said, or not lately."""
        return self._share if time.monotonic() - self._told_s <= _MAX_AGE_S else None
