"""Any candidate: all is explored, so unlikely and deferred objects get their turn."""

from __future__ import annotations

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.goals.object_choice import any_object
from surveilnav.services.planner.core.stages.objects import go_to
from surveilnav.services.planner.core.stages.stage import Retry


def any_candidate(context: StepContext) -> Decision | Retry | None:
    """Goes to the candidate of the highest utility."""
    goal = any_object(context)
    return None if goal is None else go_to(context, goal, is_fallback=True)
