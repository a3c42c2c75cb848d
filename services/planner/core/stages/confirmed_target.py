"""A confirmed target: an object that fusion confirmed as the target."""

from __future__ import annotations

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.goals.object_choice import current_lost_promise, promising_object
from surveilnav.services.planner.core.stages.exploring import compare_exploring, defer
from surveilnav.services.planner.core.stages.objects import go_to_promising, utility_to_beat
from surveilnav.services.planner.core.stages.stage import Retry


def confirmed_target(context: StepContext) -> Decision | Retry | None:
    """Goes to it, unless a candidate or exploring has a higher utility."""
    return go_to_promising(context, confirmed=True)


def leave_outdone_object(context: StepContext) -> None:
    """Stops heading for an object that isn't promising any more, or that exploring now clearly outdoes."""
    waypoint = context.state.waypoint
    if waypoint is None or waypoint.object_id is None:
        return
    goal, is_outdone = promising_object(context), False
    if goal is not None and goal.has_current:
        exploring = compare_exploring(context, utility_to_beat(context, goal))
        defer(context, exploring.constrained)
        is_outdone = exploring.is_better
    if is_outdone or current_lost_promise(context):
        context.state.record_oscillation()
