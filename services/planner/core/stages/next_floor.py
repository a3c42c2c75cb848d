"""The next floor: this one is searched, so the robot goes on to another."""

from __future__ import annotations

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.floors import evidence, may_visit, memory_of, never_leaves
from surveilnav.services.planner.core.goals.stairs import paths_to_floors
from surveilnav.services.planner.core.memory.floor_goal import FloorGoal
from surveilnav.services.planner.core.stages.stage import RETRY, Retry


def next_floor(context: StepContext) -> Retry | None:
    """Records that this floor is searched, and sends the robot to another one that isn't.

    That is the floor whose cameras saw the target with the highest confidence, else the nearest. None: there is no such floor
    to be reached, or the robot was told that the target is here.
    """
    if never_leaves(context):
        return None
    state, config = context.state, context.config
    likeliest = next(iter(objects.last_resorts(context.maps.objects, state, config)), None)
    state.here.record_searched(objects.chance(likeliest, state.target) if likeliest else 0.0)
    goal = floor_to_search(context)
    state.set_floor_goal(goal)
    return RETRY if goal is not None else None


def floor_to_search(context: StepContext) -> FloorGoal | None:
    """The floor to go to once this one is searched; None: none is left that can be reached."""
    state, paths = context.state, paths_to_floors(context)
    left = [f for f in sorted(paths) if not memory_of(context, f).is_searched and may_visit(context, f)]
    # weak evidence is no reason to pass by a floor that the robot hasn't searched
    seen = {f: e if (e := evidence(context, f)) >= context.config.floor_confidence else 0.0 for f in left}
    chosen = min(left, key=lambda f: (-seen[f], paths[f].cost_m), default=None)
    if chosen is None:
        return None
    by_evidence = f"the cameras of floor {chosen} saw {state.target!r} with {seen[chosen]:.2f}"
    why = by_evidence if seen[chosen] else f"floor {chosen} is the nearest that isn't"
    return FloorGoal(chosen, f"floor {state.floor} is searched; {why}")
