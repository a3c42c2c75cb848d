"""Which frontier to explore."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import FrontierChoice, StepContext
from surveilnav.services.planner.core.goals.frontiers import Frontier, rank


def best_frontier(context: StepContext, frontiers: Callable[[], list[Frontier]]) -> FrontierChoice | None:
    """Our ``FrontierRule``: the best frontier by the strategy; the one that the robot is on its way to is kept unless another
    is clearly better."""
    config = context.config
    if not (found := frontiers()):
        return None
    ranked, by_value = rank(found, context.maps, context.state.target, config)
    chosen, held = ranked[0], held_frontier(context, ranked, 1.5 * config.same_place_m)
    if held is not None and chosen.score <= held.score * config.switch_ratio:
        chosen = held
    return FrontierChoice(ranked, chosen, "by value" if by_value else "nearest")


def held_frontier(context: StepContext, frontiers: Sequence[Frontier], within_m: float) -> Frontier | None:
    """The one nearest to the frontier that the robot is on its way to, if one is so near to it."""
    held = context.state.waypoint
    if held is None or held.kind != "frontier":
        return None
    place = held.x_m, held.y_m
    nearest = min(frontiers, key=lambda f: math.dist((f.x_m, f.y_m), place))
    return nearest if math.dist((nearest.x_m, nearest.y_m), place) <= within_m else None


def all_frontiers(context: StepContext) -> list[Frontier]:
    """Those that aren't blacklisted, also if they are hard to get to."""
    return [f for f in context.frontiers if not memory.is_blacklisted(context.state, f.x_m, f.y_m, context.config)]
