"""Following the route to the current waypoint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.motion.drive import Route
from surveilnav.services.planner.core.options.option import Option


def follow_route(context: StepContext, goals: NDArray[np.bool_]) -> Route | None:
    """The route to the goal cells (bool of the terrain's shape), with the progress recorded.

    None: there is no route, or there was no progress for too long; the waypoint is then abandoned.
    """
    route = context.planner.route(context.terrain, goals, context.robot, context.config)
    keeps_going = context.state.update_progress(route.remaining_m if route else None, context.config)
    return route if keeps_going else None


def level_camera(context: StepContext, option: Option | None = None) -> Decision | None:
    """Brings the camera back to the horizon after the robot looked up or down; None: it is level."""
    if abs(context.robot.pitch_rad) <= context.config.turn_rad / 2:
        return None
    action = "look_up" if context.robot.pitch_rad < 0 else "look_down"
    return context.decide(action, "exploring", "levelling the camera", option)
