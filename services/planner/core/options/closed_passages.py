"""Waiting for a passage to open, because whatever is left to do on this floor, or on others, lies behind it."""

from __future__ import annotations

from collections.abc import Sequence

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals.frontier_access import available_frontiers
from surveilnav.services.planner.core.motion.areas import Area
from surveilnav.services.planner.core.options.candidates import all_candidates
from surveilnav.services.planner.core.options.option import Option
from surveilnav.services.planner.core.options.other_floors import unsearched_floors


def closed_passages(context: StepContext) -> list[Option]:
    """Waiting for the first passage whose opening alone leads on, else for all that are closed.

    No option if nothing is known to lie behind them.
    """
    closed = context.reach.closed_passages
    if not closed or not (why := _what_is_behind(context, closed)):
        return []
    passages = closed
    for area in closed:
        if behind := _what_is_behind(context, (area,)):
            passages, why = (area,), behind
            break
    x_m, y_m = passages[0].outline_m[0]
    return [Option("passage", x_m, y_m, 0.0, 0.0, 0.0, why, passages=tuple(passages), is_fallback=True)]


def _what_is_behind(context: StepContext, passages: Sequence[Area]) -> str:
    """What could be headed for if these passages were open, for people; empty if there is nothing."""
    opened = context.with_open(passages)
    if behind := max(all_candidates(opened), key=lambda option: option.utility, default=None):
        assert behind.record is not None
        return f"{behind.record.label} {behind.record.id} is behind it"
    if available_frontiers(opened):
        return "what is behind it isn't explored yet"
    for option in unsearched_floors(opened):
        assert option.floor_goal is not None
        return f"the way to floor {option.floor_goal.to_floor} leads through it"
    return ""
