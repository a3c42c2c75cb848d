"""A confirmed target: fusion calls it confirmed, by the target's name."""

from __future__ import annotations

from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals.object_choice import lost_promise, promising_object
from surveilnav.services.planner.core.stages.exploring import put_off, weigh_exploring
from surveilnav.services.planner.core.stages.objects import go_to_promising, least_worth
from surveilnav.services.planner.core.stages.stage import Retry
from surveilnav.services.planner.core.state import Decision


def confirmed_target(context: StepContext) -> Decision | Retry | None:
    """Goes to it, unless a candidate or exploring is worth more per metre."""
    return go_to_promising(context, confirmed=True)


def let_go_of_lost_object(context: StepContext) -> None:
    """The object that the robot is on its way to isn't promising any more, or exploring became worth more: notes that."""
    waypoint = context.state.waypoint
    if waypoint is None or waypoint.object_id is None:
        return
    goal, outdone = promising_object(context), False
    if goal is not None and goal.held:
        exploring = weigh_exploring(context, least_worth(context, goal))
        put_off(context, exploring.hard)
        outdone = exploring.outdoes
    if outdone or lost_promise(context):
        memory.note_wavering(context.state)
