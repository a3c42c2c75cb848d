"""Another floor: where the robot is on its way to, or whose cameras saw the target.

The robot never swings between floors: one is left unsearched only for a floor not visited before whose cameras' evidence is
better by a margin, if exploring on here isn't worth more; a searched floor isn't searched again, and visits are counted.
Nor is one left while views of its own cameras are still to come: they may show the target here, and the way back is long.
"""

from __future__ import annotations

from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals.floors import chance_here, evidence, evidence_here, memory_of, surely_here
from surveilnav.services.planner.core.goals.stairs import ways
from surveilnav.services.planner.core.pursuit.stairs import take_stair
from surveilnav.services.planner.core.stages.exploring import put_off, weigh_exploring
from surveilnav.services.planner.core.state import Decision, FloorGoal


def other_floor(context: StepContext) -> Decision | None:
    """Over the stairs to the present floor goal, or to one that this floor's lack of evidence calls for; None: stay."""
    state = context.state
    if surely_here(context):
        memory.set_floor_goal(state, None)
        return None
    if state.floor_goal is None or not _stands(context, state.floor_goal):
        _choose_floor(context)
    while state.floor_goal is not None:
        way = ways(context).get(state.floor_goal.to_floor)
        if way is None:  # barred since: explore on, or to another floor where the cameras saw the target
            if not state.here.exhausted:
                memory.set_floor_goal(state, None)
            return None
        if decision := take_stair(context, way.stair, state.floor_goal):
            return decision
    return None


def _choose_floor(context: StepContext) -> None:
    """Sets out for the floor that tempts, unless exploring on here is worth more or may turn out to be."""
    goal = None if context.maps.pending_views else _tempting(context)
    if goal is not None:
        # going there pays where there is none here: if there is one, exploring finds it on a shorter way
        here = chance_here(context)
        exploring = weigh_exploring(context, goal.worth * (1.0 - here) / here)
        put_off(context, exploring.hard)
        goal = None if exploring.outdoes else goal
    memory.set_floor_goal(context.state, goal)


def _tempting(context: StepContext) -> FloorGoal | None:
    """The floor not visited yet, with a way to it that is worth it, whose cameras saw the target surely, and more surely
    than anything here is it."""
    state, config = context.state, context.config
    found = {f: evidence(context, f) for f in sorted(context.summaries) if not memory_of(context, f).visits}
    enough = max(config.floor_confidence, evidence_here(context) + config.floor_margin)
    found = {floor: seen for floor, seen in found.items() if seen >= enough}
    reachable = ways(context) if found else {}
    best = max((floor for floor in found if floor in reachable), key=lambda floor: found[floor], default=None)
    if best is None:
        return None
    worth = found[best] / (reachable[best].cost_m + config.floor_m)
    return FloorGoal(best, f"the cameras of floor {best} saw {state.target!r} with {found[best]:.2f}", worth)


def _stands(context: StepContext, goal: FloorGoal) -> bool:
    """Whether there is still a reason to go: this floor is searched, or those cameras didn't take it back."""
    if context.state.here.exhausted:
        return True
    return evidence(context, goal.to_floor) >= context.config.floor_confidence - context.config.floor_margin
