"""Driving to stairs and taking them."""

from __future__ import annotations

import math

from surveilnav.messages import Candidate, Stair
from surveilnav.services.planner.core.behaviours.follow_route import follow_route, level_camera
from surveilnav.services.planner.core.context import Choice, StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.goals.stairs import goal_cells, goal_radius_m
from surveilnav.services.planner.core.memory.floor_goal import FloorGoal


def take_stairs(context: StepContext, stairs: Stair, goal: FloorGoal) -> Decision | None:
    """Drives to stairs and takes them. None: that isn't possible now, and a failure of the stairs was counted."""
    robot = context.robot
    (x_m, y_m), goals = stairs.at_m[:2], goal_cells(context, stairs)
    waypoint = Candidate("stairs", x_m, y_m, 0.0, True, goal.why[:120])
    choice = Choice(waypoint, (waypoint,))
    context.state.commit_to(waypoint, context.config)
    distance_m = math.hypot(x_m - robot.x_m, y_m - robot.y_m)
    if distance_m <= goal_radius_m(context, stairs) and goals[context.terrain.cell(robot.x_m, robot.y_m)]:
        n_steps = max(1, math.ceil((distance_m + stairs.length_m) / context.config.step_m - 1e-9))
        context.state.record_stairs_command(x_m, y_m, n_steps)
        message = f"taking the stairs to floor {stairs.to_floor}: {goal.why}"
        return context.decide("take_stairs", "changing floor", message, choice, to_floor=stairs.to_floor)
    route = follow_route(context, goals)
    if route is None:
        return None
    message = f"to the stairs to floor {stairs.to_floor}, {route.remaining_m:.1f} m: {goal.why}"
    return level_camera(context, choice) or context.decide(route.action, "changing floor", message, choice, route)
