"""How far away things are for the robot, and which of them only narrow gaps lead to."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from surveilnav.messages import ObjectRecord

if TYPE_CHECKING:
    from surveilnav.services.planner.core.context import StepContext
    from surveilnav.services.planner.core.reach import Reach

#: Objects stand in inflated obstacles: the way ends so near to them.
NEAR_OBJECT_M = 1.0
#: Where the map shows no way, one is expected to be so much longer than the straight line.
_DETOUR = 2.0


def likely_way_m(distance_m: float) -> float:
    """The way [m] to expect to a place at this distance where the map shows none."""
    return _DETOUR * distance_m


def travel_time_to(context: StepContext, record: ObjectRecord) -> float:
    """Travel time [m] to about where the robot would stop at an object; ``likely_way_m`` where no way is known."""
    x_m, y_m, _ = record.center_m
    time_m = _time_to_object_m(context.reach, record)
    if math.isfinite(time_m):
        return time_m
    return likely_way_m(math.hypot(x_m - context.robot.x_m, y_m - context.robot.y_m))


def is_reachable(context: StepContext, record: ObjectRecord) -> bool:
    """Whether a way leads to about where the robot would stop at an object."""
    return math.isfinite(_time_to_object_m(context.reach, record))


def is_behind_passage(context: StepContext, record: ObjectRecord) -> bool:
    """Whether a way leads to an object only once a closed passage opens."""
    if not context.reach.closed_passages or is_reachable(context, record):
        return False
    return math.isfinite(_time_to_object_m(context.reach.with_all_open, record))


def is_constrained(context: StepContext, x_m: float, y_m: float, travel_time_m: float) -> bool:
    """Whether the way to a place leads through narrow gaps that the robot most likely can't pass.

    That is so if the place is much farther than its distance explains, and avoiding such gaps takes even longer. What is seen
    through a window looks like that.
    """
    distance_m = math.hypot(x_m - context.robot.x_m, y_m - context.robot.y_m)
    if travel_time_m <= context.config.constrained_detour_m + likely_way_m(distance_m):
        return False
    around_m = context.reach.time_to_m(x_m, y_m, context.config.same_place_m, avoids_gaps=True)
    return around_m > travel_time_m + 1.0


def _time_to_object_m(reach: Reach, record: ObjectRecord) -> float:
    return reach.time_to_m(*record.center_m[:2], NEAR_OBJECT_M + 0.5 * min(record.size_m[:2]))
