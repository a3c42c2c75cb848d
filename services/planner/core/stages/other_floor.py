"""Another floor: the one that the robot is heading for, or one whose cameras saw the target.

The robot never swings between floors. It leaves one unsearched only for a floor that it hasn't visited and whose cameras'
evidence is better by a margin, if exploring on here isn't worth more. It never searches a floor twice, and its visits are
limited. It doesn't leave a floor either while views of that floor's cameras are pending: they may show the target here, and
the way back is long.
"""

from __future__ import annotations

from surveilnav.services.planner.core.behaviours.take_stairs import take_stairs
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.goals.floors import chance_here, evidence, evidence_here, memory_of, never_leaves
from surveilnav.services.planner.core.goals.stairs import paths_to_floors
from surveilnav.services.planner.core.memory.floor_goal import FloorGoal
from surveilnav.services.planner.core.stages.exploring import exploring_is_better


def other_floor(context: StepContext) -> Decision | None:
    """Goes to the stairs towards the floor goal, after choosing one if the evidence calls for it. None: the robot stays."""
    state = context.state
    if never_leaves(context):
        state.set_floor_goal(None)
        return None
    if state.floor_goal is None or not _is_still_wanted(context, state.floor_goal):
        _choose_floor(context)
    while state.floor_goal is not None:
        path = paths_to_floors(context).get(state.floor_goal.to_floor)
        if path is None:  # its stairs failed too often: explore on, or go to another floor with evidence
            if not state.here.is_searched:
                state.set_floor_goal(None)
            return None
        if decision := take_stairs(context, path.first_stairs, state.floor_goal):
            return decision
    return None


def _choose_floor(context: StepContext) -> None:
    """Sets the floor goal by the evidence, unless exploring on here is better or views are pending."""
    goal = None if context.maps.pending_views else _floor_with_better_evidence(context)
    if goal is not None:
        # leaving pays off only if there is no target here: if there is one, exploring finds it on a shorter way
        here = chance_here(context)
        goal = None if exploring_is_better(context, goal.utility * (1.0 - here) / here) else goal
    context.state.set_floor_goal(goal)


def _floor_with_better_evidence(context: StepContext) -> FloorGoal | None:
    """The reachable floor, not visited yet, with the highest evidence, if that is clearly better than the evidence here."""
    state, config = context.state, context.config
    found = {f: evidence(context, f) for f in sorted(context.summaries) if not memory_of(context, f).visits}
    enough = max(config.floor_confidence, evidence_here(context) + config.floor_margin)
    found = {floor: seen for floor, seen in found.items() if seen >= enough}
    paths = paths_to_floors(context) if found else {}
    best = max((floor for floor in found if floor in paths), key=lambda floor: found[floor], default=None)
    if best is None:
        return None
    utility = found[best] / (paths[best].cost_m + config.floor_search_m)
    return FloorGoal(best, f"the cameras of floor {best} saw {state.target!r} with {found[best]:.2f}", utility)


def _is_still_wanted(context: StepContext, goal: FloorGoal) -> bool:
    """Whether there is still a reason to go: this floor is searched, or the other floor's cameras still see the target."""
    if context.state.here.is_searched:
        return True
    return evidence(context, goal.to_floor) >= context.config.floor_confidence - context.config.floor_margin
