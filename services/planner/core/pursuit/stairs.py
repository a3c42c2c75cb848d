"""At a stair and on the way to it."""

from __future__ import annotations

import math

from surveilnav.messages import Candidate, Stair
from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import Choice, StepContext
from surveilnav.services.planner.core.goals.stairs import foot, reach_m
from surveilnav.services.planner.core.pursuit.follow import follow, level
from surveilnav.services.planner.core.state import Decision, FloorGoal


def take_stair(context: StepContext, stair: Stair, goal: FloorGoal) -> Decision | None:
    """Drives to a stair and takes it; None, with one try less, if that can't be."""
    robot = context.robot
    (x_m, y_m), goals = stair.at_m[:2], foot(context, stair)
    waypoint = Candidate("stairs", x_m, y_m, 0.0, True, goal.why[:120])
    choice = Choice(waypoint, (waypoint,))
    memory.commit(context.state, waypoint, context.config)
    away_m = math.hypot(x_m - robot.x_m, y_m - robot.y_m)
    if away_m <= reach_m(context, stair) and goals[context.terrain.cell(robot.x_m, robot.y_m)]:
        n_steps = max(1, math.ceil((away_m + stair.length_m) / context.config.step_m - 1e-9))
        memory.take_stairs(context.state, x_m, y_m, n_steps)
        message = f"taking the stairs to floor {stair.to_floor}: {goal.why}"
        return context.decide("take_stairs", "changing floor", message, choice, to_floor=stair.to_floor)
    route = follow(context, goals)
    if route is None:
        return None
    message = f"to the stairs to floor {stair.to_floor}, {route.remaining_m:.1f} m: {goal.why}"
    return level(context, choice) or context.decide(route.action, "changing floor", message, choice, route)
