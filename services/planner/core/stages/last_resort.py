"""The last resort: all floors are searched, so the likeliest object of all is accepted on weaker evidence."""

from __future__ import annotations

from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals.floors import may_visit, memory_of
from surveilnav.services.planner.core.goals.object_choice import likeliest_last_resort
from surveilnav.services.planner.core.goals.reach import way_to
from surveilnav.services.planner.core.goals.stairs import ways
from surveilnav.services.planner.core.stages.stage import RETRY, Retry
from surveilnav.services.planner.core.state import FloorGoal


def last_resort(context: StepContext) -> Retry | None:
    """Sends the robot back to the floor with the likeliest object of all, or accepts the likeliest of this floor."""
    if (goal := _better_floor(context)) is not None:
        memory.set_floor_goal(context.state, goal)
        return RETRY
    accepted = memory.accept_last_resort(context.state, likeliest_last_resort(context), context.config)
    return RETRY if accepted else None


def accept_when_steps_run_out(context: StepContext) -> None:
    """Accepts the likeliest object of this floor when the steps left just about take the robot there."""
    state, config = context.state, context.config
    best = likeliest_last_resort(context)
    if best is None:
        return
    needed = config.steps_per_m * way_to(context, best) + config.patience_steps
    if state.max_steps - state.step <= needed:
        memory.accept_last_resort(state, best, config)


def _better_floor(context: StepContext) -> FloorGoal | None:
    """The floor where something likelier is left than on this one."""
    state, reachable = context.state, ways(context)
    left = [f for f in sorted(reachable) if memory_of(context, f).accepted_object is None and may_visit(context, f)]
    best = max(left, key=lambda f: (memory_of(context, f).reserve, -reachable[f].cost_m), default=None)
    here = state.here.reserve if state.here.accepted_object is None else 0.0
    if best is None or memory_of(context, best).reserve <= here:
        return None
    return FloorGoal(best, f"all is searched, and the best seen was on floor {best}")
