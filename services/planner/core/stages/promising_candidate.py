"""A promising candidate: nobody confirmed it, but it may well be the target."""

from __future__ import annotations

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.stages.objects import go_to_promising
from surveilnav.services.planner.core.stages.stage import Retry
from surveilnav.services.planner.core.state import Decision


def promising_candidate(context: StepContext) -> Decision | Retry | None:
    """Goes to it, unless the way to another floor or exploring is worth more per metre."""
    return go_to_promising(context, confirmed=False)
