"""Any candidate: all is explored, so what hardly anything speaks for, or is hard to get to, gets its turn."""

from __future__ import annotations

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals.object_choice import any_object
from surveilnav.services.planner.core.stages.objects import go_to
from surveilnav.services.planner.core.stages.stage import Retry
from surveilnav.services.planner.core.state import Decision


def any_candidate(context: StepContext) -> Decision | Retry | None:
    """Goes to the one most worth its way."""
    goal = any_object(context)
    return None if goal is None else go_to(context, goal, unpromising=True)
