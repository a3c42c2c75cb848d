"""How far away things are for the robot, and which of them only narrow gaps lead to."""

from __future__ import annotations

import math

from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core.context import StepContext


def travel_time_to(context: StepContext, record: ObjectRecord) -> float:
    """Travel time [m] to about where the robot would stop at an object; twice the distance where no way is known."""
    x_m, y_m, _ = record.center_m
    time_m = _known_travel_time_to(context, record)
    return 2.0 * math.hypot(x_m - context.robot.x_m, y_m - context.robot.y_m) if math.isinf(time_m) else time_m


def is_reachable(context: StepContext, record: ObjectRecord) -> bool:
    """Whether a way leads to about where the robot would stop at an object."""
    return math.isfinite(_known_travel_time_to(context, record))


def is_behind_passage(context: StepContext, record: ObjectRecord) -> bool:
    """Whether a way leads to an object only once a closed passage opens."""
    if not context.closed_passages or is_reachable(context, record):
        return False
    return is_reachable(context.with_all_open, record)


def is_constrained(context: StepContext, x_m: float, y_m: float, travel_time_m: float) -> bool:
    """Whether the way to a place leads through narrow gaps that the robot most likely can't pass.

    That is so if the place is much farther than its distance explains, and avoiding such gaps takes even longer. What is seen
    through a window looks like that.
    """
    distance_m = math.hypot(x_m - context.robot.x_m, y_m - context.robot.y_m)
    if travel_time_m <= context.config.constrained_detour_m + 2.0 * distance_m:
        return False
    around_m = context.terrain.min_near(context.unconstrained_travel_time_m, x_m, y_m, context.config.same_place_m)
    return around_m > travel_time_m + 1.0


def _known_travel_time_to(context: StepContext, record: ObjectRecord) -> float:
    radius_m = 1.0 + 0.5 * min(record.size_m[:2])
    return context.terrain.min_near(context.travel_time_m, *record.center_m[:2], radius_m)
