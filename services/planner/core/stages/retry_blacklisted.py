"""Blacklisted places get another try: the map may have changed since the robot failed to reach them."""

from __future__ import annotations

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.stages.stage import RETRY, Retry


def retry_blacklisted(context: StepContext) -> Retry | None:
    """Releases all places of the floor that aren't blacklisted permanently. None: there is none."""
    return RETRY if context.state.release_blacklisted() else None
