"""How far things are for the robot, and which are hard to get to."""

from __future__ import annotations

import math

from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core.context import StepContext


def way_to(context: StepContext, record: ObjectRecord) -> float:
    """Travel time [m] to about where one would stand before an object; twice the distance where no way is known."""
    x_m, y_m, _ = record.center_m
    way_m = _known_way_to(context, record)
    return 2.0 * math.hypot(x_m - context.robot.x_m, y_m - context.robot.y_m) if math.isinf(way_m) else way_m


def is_reachable(context: StepContext, record: ObjectRecord) -> bool:
    """Whether a way leads to about where one would stand before an object."""
    return math.isfinite(_known_way_to(context, record))


def is_hard(context: StepContext, x_m: float, y_m: float, way_m: float) -> bool:
    """Whether a place is much farther than its distance explains, because the way leads through gaps that a robot most
    likely can't pass: what is seen through a window looks like that."""
    straight_m = math.hypot(x_m - context.robot.x_m, y_m - context.robot.y_m)
    if way_m <= context.config.hard_way_m + 2.0 * straight_m:
        return False
    roomy_m = context.terrain.least_near(context.roomy_travel_time_m, x_m, y_m, context.config.same_place_m)
    return roomy_m > way_m + 1.0


def _known_way_to(context: StepContext, record: ObjectRecord) -> float:
    reach_m = 1.0 + 0.5 * min(record.size_m[:2])
    return context.terrain.least_near(context.travel_time_m, *record.center_m[:2], reach_m)
