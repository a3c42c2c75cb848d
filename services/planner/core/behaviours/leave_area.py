"""Leaving an area where the robot shouldn't be: a keepout zone, or a passage that is closed."""

from __future__ import annotations

import numpy as np

from surveilnav.robot_body import clearance_m
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision


def leave_area(context: StepContext) -> Decision | None:
    """Drives out of the area that the robot stands in, before anything else. None: it stands in none.

    Without a way out the mission fails, and says where the robot stands.
    """
    terrain, robot = context.terrain, context.robot
    if not terrain.must_leave:
        return None
    r = 2 * terrain.grid.resolution_m
    places = ((robot.x_m + dx, robot.y_m + dy) for dx in (0.0, -r, r) for dy in (0.0, -r, r))
    name = next((name for place in places if (name := context.area_at(*place))), "a place where no robot is sent")
    reachable = np.isfinite(context.travel_time_m)
    beyond = reachable & terrain.known
    if terrain.barred is not None:  # a robot counts as arrived before it is there
        beyond &= clearance_m(terrain.barred.near, terrain.grid.resolution_m) > 2 * context.config.waypoint_tolerance_m
    for goals in (beyond, reachable & terrain.known, reachable):
        route = context.planner.route(terrain, goals, robot, context.config) if goals.any() else None
        if route is not None:
            return context.decide(route.action, "exploring", f"leaving {name}", route=route)
    message = f"the robot stands in {name}, and no way leads out of it"
    return Decision(None, "finished", message, finished=True, error="stuck")
