"""At a frontier and on the way to it."""

from __future__ import annotations

import math

import numpy as np

from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import Choice, StepContext
from surveilnav.services.planner.core.goals.frontiers import Frontier, unknown_side
from surveilnav.services.planner.core.motion.drive import turn_towards
from surveilnav.services.planner.core.pursuit.follow import follow, level
from surveilnav.services.planner.core.state import Decision


def explore(context: StepContext, frontier: Frontier, choice: Choice) -> Decision | None:
    """Drives to a frontier; there turns to what it hides once, and leaves it for good if it is still one. None: it was
    given up."""
    config, robot, terrain = context.config, context.robot, context.terrain
    if levelled := level(context, choice):
        return levelled
    if math.hypot(frontier.x_m - robot.x_m, frontier.y_m - robot.y_m) <= config.reached_m:
        return _look_past(context, frontier, choice)
    reachable = np.isfinite(context.travel_time_m)
    goals = terrain.disc(frontier.x_m, frontier.y_m, config.reached_m * 0.6) & reachable
    if not goals.any():
        goals = terrain.disc(frontier.x_m, frontier.y_m, config.same_place_m) & reachable
    route = follow(context, goals)
    if route is None:
        return None
    return context.decide(route.action, "exploring", f"to a frontier, {route.remaining_m:.1f} m", choice, route)


def _look_past(context: StepContext, frontier: Frontier, choice: Choice) -> Decision | None:
    state, config = context.state, context.config
    side = unknown_side(context.maps, context.terrain, frontier.x_m, frontier.y_m)
    turn = turn_towards(context.robot, *side, config) if side else None
    if turn is None or state.peeks >= config.scan_turns // 2:
        memory.blacklist(state, frontier.x_m, frontier.y_m, config, times=memory.FOR_GOOD)
        return None
    memory.note_peek(state)
    return context.decide(turn, "exploring", "looking past a frontier", choice)
