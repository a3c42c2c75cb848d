"""How near a search came to a goal, and when: what is kept of its whole way, so that its loss can be explained later."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

#: A robot is near a goal while the shortest path to the nearest viewpoint of any goal is at most this long [m].
#:
#: This is about the size of a room: a robot that is so near is mostly in the goal's room or at its door. So what is lost farther
#: away is the business of exploring, and what is lost from here on is that of believing and stopping. The path is measured and
#: not the straight line, because a goal behind a wall isn't near for a robot. Whether the goal is in sight isn't asked: a robot
#: that stands beside it and looks away has come near, and what it loses there is lost by not looking.
NEAR_M = 3.0


class Approach(msgspec.Struct, frozen=True, kw_only=True):
    """The places of a search that explain its loss. Paths are the robot's own since the start; ``left`` is the shortest path to
    the nearest viewpoint from there. All in metres.

    Attributes:
        closest_m: the least that was ever left; None: no way led to a goal from anywhere.
        first_near_path_m, first_near_left_m: where it first was near; None: it never was.
        last_near_path_m, last_near_left_m: where it came near for the last time, and stayed so until the end; None: in the end it
            wasn't near.
    """

    closest_m: float | None = None
    first_near_path_m: float | None = None
    first_near_left_m: float | None = None
    last_near_path_m: float | None = None
    last_near_left_m: float | None = None

    @property
    def came_near(self) -> bool:
        return self.first_near_path_m is not None


def approach_of(path_m: Sequence[float], left_m: Sequence[float]) -> Approach:
    """The approach of a search of which is known, at the start and after every action, the path so far and what was left.

    Args:
        path_m: never decreasing.
        left_m: as many; inf where no way leads to a goal.
    """
    closest_m, first, last = min(left_m), None, None
    for i, left in enumerate(left_m):
        if left > NEAR_M:
            last = None
            continue
        first = i if first is None else first
        last = i if last is None else last
    return Approach(
        closest_m=closest_m if math.isfinite(closest_m) else None,
        first_near_path_m=None if first is None else path_m[first],
        first_near_left_m=None if first is None else left_m[first],
        last_near_path_m=None if last is None else path_m[last],
        last_near_left_m=None if last is None else left_m[last],
    )
