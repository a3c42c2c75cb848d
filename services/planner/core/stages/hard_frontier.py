"""The best frontier of all, also of those that only tight gaps lead to."""

from __future__ import annotations

from services.planner.core.context import StepContext
from services.planner.core.goals.frontier_choice import all_frontiers
from services.planner.core.stages.exploring import explore_chosen
from services.planner.core.stages.stage import Retry
from services.planner.core.state import Decision


def hard_frontier(context: StepContext) -> Decision | Retry | None:
    """Goes to the one that the rule chooses."""
    return explore_chosen(context, context.rule(context, lambda: all_frontiers(context)))
