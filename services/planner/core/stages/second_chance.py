"""A second chance for what was tried in vain: the map may have changed since."""

from __future__ import annotations

from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.stages.stage import RETRY, Retry


def second_chance(context: StepContext) -> Retry | None:
    """Takes off the blacklist what isn't there for good."""
    return RETRY if memory.wake_all(context.state) else None
