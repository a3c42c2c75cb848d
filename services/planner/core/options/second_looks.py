"""Looking around once more: what was only seen in passing from afar may be the target after all."""

from __future__ import annotations

import math

import cv2
import numpy as np

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.options.option import Option

_SMOOTHING_M = 1.0
#: No other option is compared with a second look, so any chance will do.
_CHANCE = 0.01


def second_looks(context: StepContext) -> list[Option]:
    """The next place to look around from: far from earlier full looks around, of high value and near by.

    While the robot is turning at such a place, that place.
    """
    if context.config.second_look_m is None:
        return []
    place = _place_of_present_look(context) or _next_place(context, context.config.second_look_m)
    if place is None:
        return []
    travel_time_m = float(context.travel_time_m[context.terrain.cell(*place)])
    cost_m = travel_time_m + context.config.verify_cost_m
    why = "far from every look around"
    return [Option("second_look", *place, _CHANCE, cost_m, _CHANCE / cost_m, why, is_fallback=True)]


def is_turning(context: StepContext) -> bool:
    """Whether the robot is in the middle of a second look around."""
    state, here = context.state, (context.robot.x_m, context.robot.y_m)
    return state.second_look_turns_left > 0 and math.dist(here, state.here.scan_places[-1]) < context.config.reached_m


def _place_of_present_look(context: StepContext) -> tuple[float, float] | None:
    return context.state.here.scan_places[-1] if is_turning(context) else None


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
