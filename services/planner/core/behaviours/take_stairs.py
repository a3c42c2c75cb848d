"""Driving to stairs and taking them."""

from __future__ import annotations

import math

from surveilnav.services.planner.core.behaviours.follow_route import follow_route, level_camera
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.goals.stairs import goal_cells, goal_radius_m
from surveilnav.services.planner.core.options.option import Option


def take_stairs(context: StepContext, option: Option) -> Decision | None:
    """Drives to stairs and takes them. None: that isn't possible now, and a failure of the stairs was counted."""
    robot, stairs, goal = context.robot, option.stairs, option.floor_goal
    assert stairs is not None
    assert goal is not None
    (x_m, y_m), goals = stairs.at_m[:2], goal_cells(context, stairs)
    distance_m = math.hypot(x_m - robot.x_m, y_m - robot.y_m)
    if distance_m <= goal_radius_m(context, stairs) and goals[context.terrain.cell(robot.x_m, robot.y_m)]:
        n_steps = max(1, math.ceil((distance_m + stairs.length_m) / context.config.step_m - 1e-9))
        context.state.record_stairs_command(x_m, y_m, n_steps)
        message = f"taking the stairs to floor {stairs.to_floor}: {goal.why}"
        return context.decide("take_stairs", "changing floor", message, option, to_floor=stairs.to_floor)
    route = follow_route(context, goals)
    if route is None:
        return None
    message = f"to the stairs to floor {stairs.to_floor}, {route.remaining_m:.1f} m: {goal.why}"
    return level_camera(context, option) or context.decide(route.action, "changing floor", message, option, route)
