"""The best of all frontiers, also of those that only narrow gaps lead to."""

from __future__ import annotations

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.goals.frontier_choice import available_frontiers
from surveilnav.services.planner.core.stages.exploring import explore_chosen
from surveilnav.services.planner.core.stages.stage import Retry


def constrained_frontier(context: StepContext) -> Decision | Retry | None:
    """Explores the frontier that the rule chooses."""
    return explore_chosen(context, context.rule(context, lambda: available_frontiers(context)))
