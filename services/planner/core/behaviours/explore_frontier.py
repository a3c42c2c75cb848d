"""Exploring a frontier: driving there and looking at its unexplored side."""

from __future__ import annotations

import math

import numpy as np

from surveilnav.services.planner.core.behaviours.follow_route import follow_route, level_camera
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.goals.frontiers import Frontier, unexplored_side
from surveilnav.services.planner.core.memory.blacklist import PERMANENT_AFTER
from surveilnav.services.planner.core.motion.drive import turn_towards
from surveilnav.services.planner.core.options.option import Option


def explore_frontier(context: StepContext, option: Option) -> Decision | None:
    """Drives to a frontier and looks at its unexplored side; if it is a frontier even then, it is blacklisted permanently.

    None: it was abandoned or blacklisted.
    """
    config, robot, terrain, frontier = context.config, context.robot, context.terrain, option.frontier
    assert frontier is not None
    if levelling := level_camera(context, option):
        return levelling
    if math.hypot(frontier.x_m - robot.x_m, frontier.y_m - robot.y_m) <= config.reached_m:
        return _look_at_unexplored_side(context, frontier, option)
    reachable = np.isfinite(context.travel_time_m)
    goals = terrain.disc(frontier.x_m, frontier.y_m, config.reached_m * 0.6) & reachable
    if not goals.any():
        goals = terrain.disc(frontier.x_m, frontier.y_m, config.same_place_m) & reachable
    route = follow_route(context, goals)
    if route is None:
        return None
    return context.decide(route.action, "exploring", f"to a frontier, {route.remaining_m:.1f} m", option, route)


def _look_at_unexplored_side(context: StepContext, frontier: Frontier, option: Option) -> Decision | None:
    state, config = context.state, context.config
    side = unexplored_side(context.maps, context.terrain, frontier.x_m, frontier.y_m)
    turn = turn_towards(context.robot, *side, config) if side else None
    if turn is None or state.turns_at_frontier >= config.scan_turns // 2:
        state.blacklist_place(frontier.x_m, frontier.y_m, config, failures=PERMANENT_AFTER)
        return None
    state.record_turn_at_frontier()
    return context.decide(turn, "exploring", "looking past a frontier", option)
