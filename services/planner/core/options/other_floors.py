"""Going to another floor: the one that the robot is heading for, one whose cameras saw the target, or one not searched yet.

The robot never swings between floors. It leaves one unsearched only for a floor that it hasn't visited and whose cameras'
evidence is better by a margin. It never searches a floor twice, and its visits are limited. Nor does it
set out by evidence while views of this floor's cameras are pending: they may show the target here, and the way back is long.
"""

from __future__ import annotations

from collections.abc import Sequence

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals.floors import (
    chance_here,
    evidence,
    evidence_here,
    may_visit,
    memory_of,
    never_leaves,
)
from surveilnav.services.planner.core.goals.stairs import PathToFloor, path_to_floor_goal, paths_to_floors
from surveilnav.services.planner.core.memory.floor_goal import FloorGoal
from surveilnav.services.planner.core.options.option import Option


def other_floors(context: StepContext) -> list[Option]:
    """The floor that the robot is heading for, else those whose cameras saw the target clearly better than those here did."""
    goal, path = context.state.floor_goal, path_to_floor_goal(context)
    if goal is not None and path is not None:
        return [stairs_option(context, path, goal, evidence(context, goal.to_floor))]
    if never_leaves(context) or context.maps.pending_views:
        return []
    return [_by_evidence(context, floor, path) for floor, path in _with_better_evidence(context).items()]


def unless_objects_come_first(options: Sequence[Option]) -> list[Option]:
    """The options without stairs that aren't weighed at all, because of an object here, which costs less to look at than to come
    back for.

    That is a confirmed target or, if the robot isn't on its way to the stairs yet, any promising object.
    """
    here = {option.kind for option in options if not option.is_accepted}
    return [
        o for o in options if o.kind != "stairs" or not ("target" in here or ("candidate" in here and not o.is_current))
    ]


def unsearched_floors(context: StepContext) -> list[Option]:
    """The floors that aren't searched yet, proposed once this one is.

    Only the best is proposed: that whose cameras saw the target with the highest confidence, else the nearest.
    """
    if never_leaves(context):
        return []
    paths = paths_to_floors(context, also_unseen=True)
    left = [f for f in sorted(paths) if not memory_of(context, f).is_searched and may_visit(context, f)]
    # weak evidence is no reason to pass by a floor that the robot hasn't searched
    seen = {f: e if (e := evidence(context, f)) >= context.config.floor_confidence else 0.0 for f in left}
    chosen = min(left, key=lambda f: (-seen[f], paths[f].cost_m), default=None)
    if chosen is None:
        return []
    by_evidence = f"the cameras of floor {chosen} saw {context.state.target!r} with {seen[chosen]:.2f}"
    why = by_evidence if seen[chosen] else f"floor {chosen} is the nearest that isn't searched"
    goal = FloorGoal(chosen, f"floor {context.state.floor} is searched; {why}")
    return [stairs_option(context, paths[chosen], goal, seen[chosen])]


def stairs_option(
    context: StepContext, path: PathToFloor, goal: FloorGoal, chance: float, utility: float | None = None
) -> Option:
    """Taking the first stairs on the path to a floor. ``utility``: None once the robot has set out; then it is the goal's."""
    (x_m, y_m), waypoint = path.first_stairs.at_m[:2], context.state.waypoint
    return Option(
        "stairs",
        x_m,
        y_m,
        chance,
        path.cost_m + context.config.floor_search_m,
        goal.utility if utility is None else utility,
        goal.why,
        stairs=path.first_stairs,
        floor_goal=goal,
        is_current=waypoint is not None and waypoint.kind == "stairs",
    )


def _with_better_evidence(context: StepContext) -> dict[str, PathToFloor]:
    """The reachable floors, not visited yet, whose evidence is clearly better than the evidence here; and the paths there."""
    config = context.config
    found = {f: evidence(context, f) for f in sorted(context.summaries) if not memory_of(context, f).visits}
    enough = max(config.floor_confidence, evidence_here(context) + config.floor_margin)
    found = {floor: seen for floor, seen in found.items() if seen >= enough}
    paths = paths_to_floors(context) if found else {}
    return {floor: paths[floor] for floor in found if floor in paths}


def _by_evidence(context: StepContext, floor: str, path: PathToFloor) -> Option:
    """A floor whose cameras saw the target.

    Leaving this floor pays off only if there is no target here: if there is one, exploring finds it on a shorter way. So the
    utility is weighed by the odds that there is none.
    """
    seen, here = evidence(context, floor), chance_here(context)
    utility = seen / (path.cost_m + context.config.floor_search_m)
    why = f"the cameras of floor {floor} saw {context.state.target!r} with {seen:.2f}"
    return stairs_option(context, path, FloorGoal(floor, why, utility), seen, utility * (1.0 - here) / here)
