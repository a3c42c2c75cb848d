"""A promising candidate: nobody confirmed it, but it may well be the target."""

from __future__ import annotations

from services.planner.core import memory
from services.planner.core.context import StepContext
from services.planner.core.goals.object_choice import floor_goal_worth, promising_object
from services.planner.core.pursuit.approach import approach
from services.planner.core.stages.confirmed_target import least_worth
from services.planner.core.stages.exploring import put_off_and_weigh_exploring
from services.planner.core.stages.stage import RETRY, Retry
from services.planner.core.state import Decision


def promising_candidate(context: StepContext) -> Decision | Retry | None:
    """Goes to it, unless the way to another floor or exploring is worth more per metre."""
    goal = promising_object(context)
    if goal is None or goal.confirmed or goal.worth <= context.config.switch_ratio * floor_goal_worth(context):
        return None
    if put_off_and_weigh_exploring(context, least_worth(context, goal)):
        return None
    memory.commit(context.state, goal.choice.chosen, context.config)
    return approach(context, goal.record, goal.choice) or RETRY
