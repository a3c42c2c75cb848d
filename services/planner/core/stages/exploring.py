"""Exploring: which frontiers are considered, and whether they beat another waypoint."""

from __future__ import annotations

import math

from surveilnav.messages import Candidate
from surveilnav.services.planner.core.behaviours.explore_frontier import explore_frontier
from surveilnav.services.planner.core.context import Choice, FrontierChoice, StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.goals.frontier_choice import available_frontiers
from surveilnav.services.planner.core.goals.frontiers import Frontier, rank
from surveilnav.services.planner.core.goals.travel import is_constrained
from surveilnav.services.planner.core.stages.stage import RETRY, Retry


def frontier(context: StepContext) -> Decision | Retry | None:
    """Explores a frontier that can be reached without narrow gaps, by the rule's choice, and defers the others."""
    return _explore_chosen(context, context.rule(context, lambda: _defer_constrained_frontiers(context)))


def constrained_frontier(context: StepContext) -> Decision | Retry | None:
    """Explores the frontier that the rule chooses of all, also of those that only narrow gaps lead to."""
    return _explore_chosen(context, context.rule(context, lambda: available_frontiers(context)))


def exploring_is_better(context: StepContext, utility: float) -> bool:
    """Whether some frontier has a higher utility (chance per metre) than another waypoint.

    The frontiers found to be reachable only through narrow gaps are deferred.
    """
    config = context.config
    chance = config.explore_chance
    if config.objects_first or chance * (1.0 + config.value_gain) <= utility * config.explore_cost_m:
        return False  # no frontier could be better, so none is looked at
    unconstrained = _defer_constrained_frontiers(context)
    if not unconstrained:
        return False
    ranked, _ = rank(unconstrained, context.maps, context.state.target, config)
    return chance * ranked[0].score > utility


def _defer_constrained_frontiers(context: StepContext) -> list[Frontier]:
    """The available frontiers that aren't deferred. Those that only narrow gaps lead to are deferred now.

    A frontier near a constrained one that comes before it in the list counts as deferred, too.
    """
    here, near_m = context.state.here, context.config.same_place_m
    unconstrained: list[Frontier] = []
    for f in available_frontiers(context):
        if any(math.dist(place, (f.x_m, f.y_m)) < near_m for place in here.deferred_frontiers):
            continue
        if is_constrained(context, f.x_m, f.y_m, f.travel_time_m):
            here.defer_frontier(f.x_m, f.y_m)
        else:
            unconstrained.append(f)
    return unconstrained


def _explore_chosen(context: StepContext, choice: FrontierChoice | None) -> Decision | Retry | None:
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
