"""Waiting for a passage to open, because whatever is left to do on this floor, or on others, lies behind it."""

from __future__ import annotations

from collections.abc import Sequence

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.goals.floors import never_leaves
from surveilnav.services.planner.core.goals.frontier_choice import available_frontiers
from surveilnav.services.planner.core.goals.object_choice import any_object
from surveilnav.services.planner.core.motion.areas import Area
from surveilnav.services.planner.core.stages.next_floor import floor_to_search


def closed_passage(context: StepContext) -> Decision | None:
    """Waits for the first passage whose opening alone leads on, else for all that are closed. None: nothing is known behind them.

    To be asked only once nothing else is left.
    """
    closed = context.closed_passages
    if not closed or not (why := _what_is_behind(context, closed)):
        return None
    alone = ((area, _what_is_behind(context, (area,))) for area in closed)
    key, why = next(((found, reason) for found, reason in alone if reason), (None, why))
    waits_for = (key,) if key else closed
    names = " or ".join(area.name for area in waits_for)
    message = f"waits for {names}, which is closed: {why}"
    return Decision(None, "waiting", message, waits_for=tuple(area.passage for area in waits_for))


def _what_is_behind(context: StepContext, passages: Sequence[Area]) -> str:
    """What could be headed for if these passages were open, for people; empty if there is nothing."""
    opened = context.with_open(passages)
    if (goal := any_object(opened)) is not None:
        return f"{goal.record.label} {goal.record.id} is behind it"
    if available_frontiers(opened):
        return "what is behind it isn't explored yet"
    if not never_leaves(opened) and (floor := floor_to_search(opened)) is not None:
        return f"the way to floor {floor.to_floor} leads through it"
    return ""
