"""The second look around: what was only glanced at from afar may be the target after all."""

from __future__ import annotations

import math

import cv2
import numpy as np

from surveilnav.messages import Candidate
from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.pursuit.follow import follow, level
from surveilnav.services.planner.core.state import Decision

_SMOOTHED_M = 1.0
_GOAL_RADIUS_M = 0.2


def second_look(context: StepContext) -> Decision | None:
    """Looks all around once more from places far from earlier such looks, the most promising and nearest first. None when
    no such place is left."""
    state, config, robot = context.state, context.config, context.robot
    if config.second_look_m is None:
        return None
    if state.second_look_left and math.dist((robot.x_m, robot.y_m), state.here.scans[-1]) < config.reached_m:
        memory.set_second_look(state, state.second_look_left - 1)
        memory.rest(state)
        message = f"looking around once more, {state.second_look_left} turns to go"
        return context.decide("turn_left", "second look", message)
    memory.set_second_look(state, 0)
    while (place := _place(context, config.second_look_m)) is not None:
        if math.dist(place, (robot.x_m, robot.y_m)) <= config.reached_m:
            memory.note_scan(state, robot.x_m, robot.y_m)
            memory.set_second_look(state, config.scan_turns - 1)
            return context.decide("turn_left", "second look", "looking around once more")
        memory.commit(state, Candidate("second_look", *place, 0.0, True, "far from every look around"), config)
        route = follow(context, context.terrain.disc(*place, _GOAL_RADIUS_M) & np.isfinite(context.travel_time_m))
        if route is not None:
            message = f"to look around once more, {route.remaining_m:.1f} m"
            return level(context) or context.decide(route.action, "second look", message, route=route)
        memory.note_scan(state, *place)  # it can't be got to: as good as looked at
    return None


def _place(context: StepContext, around_m: float) -> tuple[float, float] | None:
    """Where to look around next; the present choice is kept while it stands."""
    state, config, terrain, held = context.state, context.config, context.terrain, context.state.waypoint
    unseen = np.ones(terrain.grid.shape, dtype=np.uint8)
    for x_m, y_m in state.here.scans:
        unseen[terrain.disc(x_m, y_m, around_m)] = 0
    places = (unseen != 0) & terrain.known & np.isfinite(context.travel_time_m) & (terrain.speed > config.tight_speed)
    if held is not None and held.kind == "second_look" and places[terrain.cell(held.x_m, held.y_m)]:
        return held.x_m, held.y_m
    if not places.any():
        return None
    value = np.nan_to_num(terrain.crop(context.maps.value), nan=0.0)
    window = 2 * round(_SMOOTHED_M / terrain.grid.resolution_m) + 1
    score = cv2.blur(value.astype(np.float32), (window, window)) - config.distance_weight_per_m * context.travel_time_m
    row, col = np.unravel_index(int(np.argmax(np.where(places, score, -np.inf))), score.shape)
    return terrain.place(int(row), int(col))
