"""Exploring: which frontiers there are to explore. How each is rated is the ``FrontierRule``'s business."""

from __future__ import annotations

from collections.abc import Sequence

from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.context import FrontierRule, RatedFrontier, StepContext
from surveilnav.services.planner.core.goals.frontier_access import available_frontiers, current_frontier
from surveilnav.services.planner.core.goals.frontiers import Frontier, exploring_cost_m, rank
from surveilnav.services.planner.core.goals.stairs import path_to_floor_goal
from surveilnav.services.planner.core.options.option import Option
from surveilnav.services.planner.core.places.rule import by_places


def frontiers(context: StepContext) -> list[Option]:
    """The frontiers that can be reached without narrow gaps. A robot on its way to another floor doesn't explore on the way."""
    if path_to_floor_goal(context) is not None:
        return []
    return _options(context, context.frontiers_by_access[0])


def constrained_frontiers(context: StepContext) -> list[Option]:
    """All frontiers, also those that only narrow gaps lead to: for when nothing else is left."""
    return _options(context, available_frontiers(context))


def rule_of(config: PlannerConfig) -> FrontierRule:
    """The ``FrontierRule`` of the strategy."""
    return by_places if config.strategy == "places" else by_chance_per_metre


def by_chance_per_metre(context: StepContext, found: Sequence[Frontier]) -> list[RatedFrontier]:
    """The ``FrontierRule`` of the paper's strategies: the chance that exploring a frontier finds the target, for each metre of
    the way there and beyond."""
    config = context.config
    ranked, by_value = rank(found, context.maps, context.state.target, config)
    why = "by value, width and way" if by_value else "by width and way"
    return [
        RatedFrontier(
            f,
            min(1.0, config.explore_chance * f.relative_chance),
            config.explore_chance * f.score,
            exploring_cost_m(f, config),
            why,
        )
        for f in ranked
    ]


def only(context: StepContext, chosen: Frontier, compared: Sequence[Frontier], why: str) -> list[RatedFrontier]:
    """The answer of a ``FrontierRule`` that chooses one frontier without saying what it is worth.

    It gets ``explore_chance``, the chance of a wide frontier of the lowest value, so that it can be compared with objects. The
    others are never chosen.
    """
    chance = context.config.explore_chance
    worth = chance / exploring_cost_m(chosen, context.config)
    return [
        RatedFrontier(f, chance, worth if f is chosen else 0.0, exploring_cost_m(f, context.config), why)
        for f in compared
    ]


def _options(context: StepContext, found: Sequence[Frontier]) -> list[Option]:
    rated = context.rule(context, found)
    current = current_frontier(context, [r.frontier for r in rated], 1.5 * context.config.same_place_m)
    return [_option(context, r, is_current=r.frontier is current) for r in rated]


def _option(context: StepContext, rated: RatedFrontier, *, is_current: bool) -> Option:
    f = rated.frontier
    return Option(
        "frontier",
        f.x_m,
        f.y_m,
        rated.chance,
        rated.cost_m,
        rated.utility,
        f"{rated.why}, {f.travel_time_m:.1f} m",
        frontier=f,
        is_current=is_current,
        spend_m=rated.cost_m - f.travel_time_m,
    )
