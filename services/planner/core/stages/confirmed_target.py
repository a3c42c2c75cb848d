"""A confirmed target: fusion calls it confirmed, by the target's name."""

from __future__ import annotations

from services.planner.core import memory
from services.planner.core.context import StepContext
from services.planner.core.goals.object_choice import ObjectGoal, lost_promise, promising_object
from services.planner.core.pursuit.approach import approach
from services.planner.core.stages.exploring import put_off_and_weigh_exploring
from services.planner.core.stages.stage import RETRY, Retry
from services.planner.core.state import Decision


def confirmed_target(context: StepContext) -> Decision | Retry | None:
    """Goes to it, unless a candidate or exploring is worth more per metre."""
    goal = promising_object(context)
    if goal is None or not goal.confirmed or put_off_and_weigh_exploring(context, least_worth(context, goal)):
        return None
    memory.commit(context.state, goal.choice.chosen, context.config)
    return approach(context, goal.record, goal.choice) or RETRY


def least_worth(context: StepContext, goal: ObjectGoal) -> float:
    """What another waypoint must be worth to be taken instead: clearly more while the robot is on its way to an object."""
    return goal.worth * (context.config.switch_ratio if goal.held else 1.0)


def let_go_of_lost_object(context: StepContext) -> None:
    """The object that the robot is on its way to isn't promising any more, or exploring became worth more: notes that."""
    held = context.state.waypoint
    if held is None or held.object_id is None:
        return
    goal = promising_object(context)
    outdone = goal is not None and goal.held and put_off_and_weigh_exploring(context, least_worth(context, goal))
    if outdone or lost_promise(context):
        memory.note_wavering(context.state)
