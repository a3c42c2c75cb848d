"""The next floor: this one is searched, so the robot goes on to another."""

from __future__ import annotations

from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.floors import evidence, may_visit, memory_of, surely_here
from surveilnav.services.planner.core.goals.stairs import ways
from surveilnav.services.planner.core.stages.stage import RETRY, Retry
from surveilnav.services.planner.core.state import FloorGoal


def next_floor(context: StepContext) -> Retry | None:
    """Sends the robot to the floor whose cameras saw the target most surely, if they did, else to the nearest that isn't
    searched. None: there is none to be got to, or the robot was told that the target is here."""
    if surely_here(context):
        return None
    state, config = context.state, context.config
    left = next(iter(objects.last_resorts(context.maps.objects, state, config)), None)
    memory.note_exhausted(state, objects.chance(left, state.target) if left else 0.0)
    goal = _next(context)
    memory.set_floor_goal(state, goal)
    return RETRY if goal is not None else None


def _next(context: StepContext) -> FloorGoal | None:
    state, reachable = context.state, ways(context)
    left = [f for f in sorted(reachable) if not memory_of(context, f).exhausted and may_visit(context, f)]
    # what is less than sure is no reason to pass by a floor that nobody has looked at
    saw = {f: e if (e := evidence(context, f)) >= context.config.floor_confidence else 0.0 for f in left}
    chosen = min(left, key=lambda f: (-saw[f], reachable[f].cost_m), default=None)
    if chosen is None:
        return None
    sure = f"the cameras of floor {chosen} saw {state.target!r} with {saw[chosen]:.2f}"
    why = sure if saw[chosen] else f"floor {chosen} is the nearest that isn't"
    return FloorGoal(chosen, f"floor {state.floor} is searched; {why}")
