"""Waiting for a closed passage to open."""

from __future__ import annotations

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.options.option import Option


def wait_for_passage(context: StepContext, option: Option) -> Decision:
    """Waits where the robot stands; the mission says for which door or lift, and what is behind it."""
    names = " and ".join(area.name for area in option.passages)
    message = f"waits for {names}, which {'is' if len(option.passages) == 1 else 'are'} closed: {option.why}"
    return Decision(None, "waiting", message, waits_for=tuple(area.passage for area in option.passages))
