"""A promising candidate: an object that isn't confirmed, but may well be the target."""

from __future__ import annotations

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.stages.objects import go_to_promising
from surveilnav.services.planner.core.stages.stage import Retry


def promising_candidate(context: StepContext) -> Decision | Retry | None:
    """Goes to it, unless going to another floor or exploring has a higher utility."""
    return go_to_promising(context, confirmed=False)
