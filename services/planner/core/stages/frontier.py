"""The best frontier that is easy to get to."""

from __future__ import annotations

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.stages.exploring import explore_chosen, put_off_hard_frontiers
from surveilnav.services.planner.core.stages.stage import Retry
from surveilnav.services.planner.core.state import Decision


def frontier(context: StepContext) -> Decision | Retry | None:
    """Goes to the one that the rule chooses; those that are hard to get to are put off."""
    return explore_chosen(context, context.rule(context, lambda: put_off_hard_frontiers(context)))
