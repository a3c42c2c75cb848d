"""The last resort: all floors are searched, so the likeliest object of all is accepted on weaker evidence."""

from __future__ import annotations

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals.floors import may_visit, memory_of
from surveilnav.services.planner.core.goals.object_choice import likeliest_last_resort
from surveilnav.services.planner.core.goals.stairs import paths_to_floors
from surveilnav.services.planner.core.goals.travel import travel_time_to
from surveilnav.services.planner.core.memory.floor_goal import FloorGoal
from surveilnav.services.planner.core.stages.stage import RETRY, Retry


def last_resort(context: StepContext) -> Retry | None:
    """Sends the robot to the floor with the likeliest object left, or accepts the likeliest object of this floor."""
    if (goal := _better_floor(context)) is not None:
        context.state.set_floor_goal(goal)
        return RETRY
    is_new = context.state.accept_last_resort(likeliest_last_resort(context), context.config)
    return RETRY if is_new else None


def accept_when_steps_run_out(context: StepContext) -> None:
    """Accepts the likeliest object of this floor once the steps left just about suffice to get there."""
    state, config = context.state, context.config
    best = likeliest_last_resort(context)
    if best is None:
        return
    steps_needed = config.steps_per_m * travel_time_to(context, best) + config.patience_steps
    if state.max_steps - state.step <= steps_needed:
        state.accept_last_resort(best, config)


def _better_floor(context: StepContext) -> FloorGoal | None:
    """The floor with an object left that is likelier than every object left on this one; None: there is none."""
    state, paths = context.state, paths_to_floors(context)
    left = [f for f in sorted(paths) if memory_of(context, f).accepted_object is None and may_visit(context, f)]
    best = max(left, key=lambda f: (memory_of(context, f).best_remaining_chance, -paths[f].cost_m), default=None)
    chance_here = state.here.best_remaining_chance if state.here.accepted_object is None else 0.0
    if best is None or memory_of(context, best).best_remaining_chance <= chance_here:
        return None
    return FloorGoal(best, f"all is searched, and the best seen was on floor {best}")
