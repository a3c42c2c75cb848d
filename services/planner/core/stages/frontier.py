"""The best frontier that can be reached without narrow gaps."""

from __future__ import annotations

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.stages.exploring import defer_constrained_frontiers, explore_chosen
from surveilnav.services.planner.core.stages.stage import Retry


def frontier(context: StepContext) -> Decision | Retry | None:
    """Explores the frontier that the rule chooses; those that only narrow gaps lead to are deferred."""
    return explore_chosen(context, context.rule(context, lambda: defer_constrained_frontiers(context)))
