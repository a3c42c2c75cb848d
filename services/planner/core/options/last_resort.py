"""The last resort: all floors are searched or the steps run out, so the likeliest object is accepted on weaker evidence."""

from __future__ import annotations

from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.floors import may_visit, memory_of
from surveilnav.services.planner.core.goals.stairs import paths_to_floors
from surveilnav.services.planner.core.goals.travel import is_reachable, travel_time_to
from surveilnav.services.planner.core.memory.floor_goal import FloorGoal
from surveilnav.services.planner.core.options.candidates import is_left_alone, object_option
from surveilnav.services.planner.core.options.option import Option
from surveilnav.services.planner.core.options.other_floors import stairs_option


def accepted_object(context: StepContext) -> list[Option]:
    """The object that was accepted before; or the likeliest of this floor, once the steps left only just suffice to get there."""
    best = likeliest_last_resort(context)
    if best is None:
        return []
    if best.id == context.state.here.accepted_object:
        return [] if is_left_alone(context, best) else [object_option(context, best, is_accepted=True)]
    return [object_option(context, best, is_accepted=True)] if _steps_run_out(context, best) else []


def last_resort(context: StepContext) -> list[Option]:
    """The floor with an object left that is likelier than every object left here; else the likeliest object of this floor."""
    if (floor := _better_floor(context)) is not None:
        goal = FloorGoal(floor, f"all is searched, and the best seen was on floor {floor}")
        path = paths_to_floors(context, also_unseen=True)[floor]
        return [stairs_option(context, path, goal, memory_of(context, floor).best_remaining_chance)]
    best = likeliest_last_resort(context)
    if best is None or best.id == context.state.here.accepted_object:
        return []
    return [object_option(context, best, is_fallback=True, is_accepted=True)]


def likeliest_last_resort(context: StepContext) -> ObjectRecord | None:
    """The last resort that was accepted before, while it still is one; else the likeliest that a way leads to."""
    state = context.state
    last_resorts = objects.last_resorts(context.possible_targets, state, context.config)
    accepted = next((o for o in last_resorts if o.id == state.here.accepted_object), None)
    return accepted or next((o for o in last_resorts if is_reachable(context, o)), None)


def _steps_run_out(context: StepContext, record: ObjectRecord) -> bool:
    """Whether the steps left just about suffice to get to an object."""
    state, config = context.state, context.config
    steps_needed = config.steps_per_m * travel_time_to(context, record) + config.patience_steps
    return state.max_steps - state.step <= steps_needed


def _better_floor(context: StepContext) -> str | None:
    state, paths = context.state, paths_to_floors(context, also_unseen=True)
    left = [f for f in sorted(paths) if memory_of(context, f).accepted_object is None and may_visit(context, f)]
    best = max(left, key=lambda f: (memory_of(context, f).best_remaining_chance, -paths[f].cost_m), default=None)
    chance_here = state.here.best_remaining_chance if state.here.accepted_object is None else 0.0
    if best is None or memory_of(context, best).best_remaining_chance <= chance_here:
        return None
    return best
