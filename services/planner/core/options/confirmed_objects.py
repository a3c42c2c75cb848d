"""Going to an object that fusion confirmed as the target."""

from __future__ import annotations

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.options.candidates import is_left_alone, object_option
from surveilnav.services.planner.core.options.option import Option


def confirmed_objects(context: StepContext) -> list[Option]:
    """The confirmed targets of this floor that the robot may head for."""
    known = objects.candidates(context.possible_targets, context.state, context.config)
    return [
        object_option(context, o)
        for o in known
        if objects.is_confirmed(o, context.state.target)
        and o.id != context.state.here.accepted_object
        and not is_left_alone(context, o)
    ]
