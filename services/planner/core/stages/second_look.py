"""The second look around: what was only seen in passing from afar may be the target after all."""

from __future__ import annotations

import math

import cv2
import numpy as np

from surveilnav.messages import Candidate
from surveilnav.services.planner.core.behaviours.follow_route import follow_route, level_camera
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision

_SMOOTHING_M = 1.0
_GOAL_RADIUS_M = 0.2


def second_look(context: StepContext) -> Decision | None:
    """Looks all around from places far from earlier full looks around, those of high value and near by first.

    None: no such place is left.
    """
    state, config, robot = context.state, context.config, context.robot
    if config.second_look_m is None:
        return None
    here = robot.x_m, robot.y_m
    if state.second_look_turns_left and math.dist(here, state.here.scan_places[-1]) < config.reached_m:
        state.set_second_look(state.second_look_turns_left - 1)
        state.reset_stuck_timer()
        message = f"looking around once more, {state.second_look_turns_left} turns to go"
        return context.decide("turn_left", "second look", message)
    state.set_second_look(0)
    while (place := _next_place(context, config.second_look_m)) is not None:
        if math.dist(place, here) <= config.reached_m:
            state.here.record_scan_place(*here)
            state.set_second_look(config.scan_turns - 1)
            return context.decide("turn_left", "second look", "looking around once more")
        state.commit_to(Candidate("second_look", *place, 0.0, True, "far from every look around"), config)
        goals = context.terrain.disc(*place, _GOAL_RADIUS_M) & np.isfinite(context.travel_time_m)
        route = follow_route(context, goals)
        if route is not None:
            message = f"to look around once more, {route.remaining_m:.1f} m"
            return level_camera(context) or context.decide(route.action, "second look", message, route=route)
        state.here.record_scan_place(*place)  # it can't be reached, so it isn't tried again
    return None


def _next_place(context: StepContext, radius_m: float) -> tuple[float, float] | None:
    """Where to look around next: farther than ``radius_m`` from every full look around. The current choice is kept while it
    is such a place. None: there is none."""
    state, config, terrain, waypoint = context.state, context.config, context.terrain, context.state.waypoint
    unseen = np.ones(terrain.grid.shape, dtype=np.uint8)
    for x_m, y_m in state.here.scan_places:
        unseen[terrain.disc(x_m, y_m, radius_m)] = 0
    is_open = terrain.known & np.isfinite(context.travel_time_m) & (terrain.speed > config.constrained_speed)
    places = (unseen != 0) & is_open
    if waypoint is not None and waypoint.kind == "second_look" and places[terrain.cell(waypoint.x_m, waypoint.y_m)]:
        return waypoint.x_m, waypoint.y_m
    if not places.any():
        return None
    value = np.nan_to_num(terrain.crop(context.maps.value), nan=0.0)
    window = 2 * round(_SMOOTHING_M / terrain.grid.resolution_m) + 1
    score = cv2.blur(value.astype(np.float32), (window, window)) - config.distance_weight_per_m * context.travel_time_m
    row, col = np.unravel_index(int(np.argmax(np.where(places, score, -np.inf))), score.shape)
    return terrain.centre_of(int(row), int(col))
