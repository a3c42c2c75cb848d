"""The best frontier of all, also of those that only tight gaps lead to."""

from __future__ import annotations

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals.frontier_choice import all_frontiers
from surveilnav.services.planner.core.stages.exploring import explore_chosen
from surveilnav.services.planner.core.stages.stage import Retry
from surveilnav.services.planner.core.state import Decision


def hard_frontier(context: StepContext) -> Decision | Retry | None:
    """Goes to the one that the rule chooses."""
    return explore_chosen(context, context.rule(context, lambda: all_frontiers(context)))
