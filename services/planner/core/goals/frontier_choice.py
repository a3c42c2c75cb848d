"""Which frontier to explore."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from surveilnav.services.planner.core.context import FrontierChoice, StepContext
from surveilnav.services.planner.core.goals.frontiers import Frontier, rank


def best_frontier(context: StepContext, frontiers: Callable[[], list[Frontier]]) -> FrontierChoice | None:
    """Our ``FrontierRule``: the best frontier by the strategy. The current one is kept unless another is clearly better."""
    config = context.config
    if not (found := frontiers()):
        return None
    ranked, by_value = rank(found, context.maps, context.state.target, config)
    chosen, current = ranked[0], current_frontier(context, ranked, 1.5 * config.same_place_m)
    if current is not None and chosen.score <= current.score * config.switch_ratio:
        chosen = current
    return FrontierChoice(ranked, chosen, "by value" if by_value else "nearest")


def current_frontier(context: StepContext, frontiers: Sequence[Frontier], within_m: float) -> Frontier | None:
    """The frontier nearest to the one that the robot is heading for; None: none within this distance, or it isn't exploring."""
    waypoint = context.state.waypoint
    if waypoint is None or waypoint.kind != "frontier":
        return None
    place = waypoint.x_m, waypoint.y_m
    nearest = min(frontiers, key=lambda f: math.dist((f.x_m, f.y_m), place))
    return nearest if math.dist((nearest.x_m, nearest.y_m), place) <= within_m else None


def available_frontiers(context: StepContext) -> list[Frontier]:
    """All frontiers that aren't blacklisted, also those that only narrow gaps lead to."""
    return [f for f in context.frontiers if not context.state.is_blacklisted(f.x_m, f.y_m, context.config)]
