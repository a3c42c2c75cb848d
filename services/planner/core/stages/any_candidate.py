"""Any candidate: all is explored, so what hardly anything speaks for, or is hard to get to, gets its turn."""

from __future__ import annotations

from services.planner.core import memory
from services.planner.core.context import StepContext
from services.planner.core.goals.object_choice import any_object
from services.planner.core.pursuit.approach import approach
from services.planner.core.stages.stage import RETRY, Retry
from services.planner.core.state import Decision


def any_candidate(context: StepContext) -> Decision | Retry | None:
    """Goes to the one most worth its way."""
    goal = any_object(context)
    if goal is None:
        return None
    memory.commit(context.state, goal.choice.chosen, context.config, unpromising=True)
    return approach(context, goal.record, goal.choice) or RETRY
