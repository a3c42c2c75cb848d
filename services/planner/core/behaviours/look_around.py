"""Looking all around once more from a place of the second look."""

from __future__ import annotations

import math

import numpy as np

from surveilnav.services.planner.core.behaviours.follow_route import follow_route, level_camera
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.options.option import Option
from surveilnav.services.planner.core.options.second_looks import is_turning

_GOAL_RADIUS_M = 0.2


def look_around(context: StepContext, option: Option) -> Decision | None:
    """Drives to the place and turns all around there. None: no way leads there, so it isn't tried again."""
    state, config, place = context.state, context.config, (option.x_m, option.y_m)
    here = context.robot.x_m, context.robot.y_m
    if is_turning(context):
        state.set_second_look(state.second_look_turns_left - 1)
        state.reset_stuck_timer()
        message = f"looking around once more, {state.second_look_turns_left} turns to go"
        return context.decide("turn_left", "second look", message)
    state.set_second_look(0)
    if math.dist(place, here) <= config.reached_m:
        state.here.record_scan_place(*here)
        state.set_second_look(config.scan_turns - 1)
        return context.decide("turn_left", "second look", "looking around once more")
    goals = context.terrain.disc(*place, _GOAL_RADIUS_M) & np.isfinite(context.travel_time_m)
    route = follow_route(context, goals)
    if route is None:
        state.here.record_scan_place(*place)
        return None
    message = f"to look around once more, {route.remaining_m:.1f} m"
    return level_camera(context) or context.decide(route.action, "second look", message, option, route)
