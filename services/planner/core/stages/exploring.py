"""What stages share about exploring: which frontiers are considered, and whether exploring beats another waypoint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from surveilnav.messages import Candidate
from surveilnav.services.planner.core.behaviours.explore_frontier import explore_frontier
from surveilnav.services.planner.core.context import Choice, FrontierChoice, StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.goals.frontier_choice import available_frontiers
from surveilnav.services.planner.core.goals.frontiers import Frontier, rank
from surveilnav.services.planner.core.goals.travel import is_constrained
from surveilnav.services.planner.core.stages.stage import RETRY, Retry


@dataclass(frozen=True, slots=True)
class ExploringComparison:
    """Exploring compared with another waypoint.

    ``is_better``: some frontier has a higher utility. ``constrained``: the frontiers found to be reachable only through narrow
    gaps; the caller defers them.
    """

    is_better: bool
    constrained: Sequence[Frontier] = ()


def compare_exploring(context: StepContext, utility: float) -> ExploringComparison:
    """Compares exploring with a waypoint of this utility (chance per metre). Changes nothing."""
    config = context.config
    chance = config.explore_chance
    if config.objects_first or chance * (1.0 + config.value_gain) <= utility * config.explore_cost_m:
        return ExploringComparison(False)  # no frontier could be better, so none is looked at
    unconstrained, constrained = _split_frontiers(context)
    if not unconstrained:
        return ExploringComparison(False, constrained)
    ranked, _ = rank(unconstrained, context.maps, context.state.target, config)
    return ExploringComparison(chance * ranked[0].score > utility, constrained)


def defer(context: StepContext, frontiers: Sequence[Frontier]) -> None:
    """Leaves frontiers for the end."""
    for f in frontiers:
        context.state.here.defer_frontier(f.x_m, f.y_m)


def defer_constrained_frontiers(context: StepContext) -> list[Frontier]:
    """Defers the frontiers that only narrow gaps lead to, and returns the other available ones."""
    unconstrained, constrained = _split_frontiers(context)
    defer(context, constrained)
    return unconstrained


def _split_frontiers(context: StepContext) -> tuple[list[Frontier], list[Frontier]]:
    """The available frontiers that aren't deferred: those that can be reached without narrow gaps, and those that can't.

    A frontier near a constrained one that comes before it in the list is in neither.
    """
    near_m = context.config.same_place_m
    deferred = list(context.state.here.deferred_frontiers)
    unconstrained: list[Frontier] = []
    constrained: list[Frontier] = []
    for f in available_frontiers(context):
        if any(math.dist(place, (f.x_m, f.y_m)) < near_m for place in deferred):
            continue
        if is_constrained(context, f.x_m, f.y_m, f.travel_time_m):
            deferred.append((f.x_m, f.y_m))
            constrained.append(f)
        else:
            unconstrained.append(f)
    return unconstrained, constrained


def explore_chosen(context: StepContext, choice: FrontierChoice | None) -> Decision | Retry | None:
    """Commits to the frontier that a rule chose, and explores it."""
    if choice is None:
        return None
    compared = tuple(
        Candidate("frontier", f.x_m, f.y_m, f.score, f is choice.chosen, f"{choice.why}, {f.travel_time_m:.1f} m")
        for f in choice.compared
    )
    waypoint = Choice(next(c for c in compared if c.chosen), compared)
    context.state.commit_to(waypoint.chosen, context.config)
    return explore_frontier(context, choice.chosen, waypoint) or RETRY
