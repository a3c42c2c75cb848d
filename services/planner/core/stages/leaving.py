"""Leaving an area where the robot shouldn't be: a keepout zone, or a passage that is closed."""

from __future__ import annotations

import numpy as np

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision


def leave_area(context: StepContext) -> Decision | None:
    """Drives out of the area that the robot stands in, before anything else. None: it stands in none.

    Without a way out the mission fails, and says where the robot stands.
    """
    terrain, robot = context.terrain, context.robot
    here = terrain.cell(robot.x_m, robot.y_m)
    if terrain.barred is None or not terrain.barred.inside[here]:
        return None
    name = context.area_at(robot.x_m, robot.y_m) or "a place where no robot is sent"
    context.state.reset_stuck_timer()
    reachable = np.isfinite(context.travel_time_m)
    for goals in (reachable & terrain.known, reachable):
        route = context.planner.route(terrain, goals, robot, context.config) if goals.any() else None
        if route is not None:
            return context.decide(route.action, "exploring", f"leaving {name}", route=route)
    message = f"the robot stands in {name}, and no way leads out of it"
    return Decision(None, "finished", message, finished=True, error="stuck")
