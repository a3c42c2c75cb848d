"""Following the way to the waypoint that the robot is committed to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import Choice, StepContext
from surveilnav.services.planner.core.motion.drive import Route
from surveilnav.services.planner.core.state import Decision


def follow(context: StepContext, goals: NDArray[np.bool_]) -> Route | None:
    """The way to the goal cells (bool of the terrain's shape); None, and the waypoint is given up, if there is none or
    nothing was gained for long."""
    route = context.planner.route(context.terrain, goals, context.robot, context.config)
    gained = memory.note_way(context.state, route.remaining_m if route else None, context.config)
    return route if gained else None


def level(context: StepContext, choice: Choice | None = None) -> Decision | None:
    """Brings the camera back to the horizon after a look; None: it looks there."""
    if abs(context.robot.pitch_rad) <= context.config.turn_rad / 2:
        return None
    action = "look_up" if context.robot.pitch_rad < 0 else "look_down"
    return context.decide(action, "exploring", "levelling the camera", choice)
