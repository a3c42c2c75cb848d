"""Which frontiers the robot may explore now, and which of them only narrow gaps lead to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from surveilnav.services.planner.core.goals.frontiers import Frontier
from surveilnav.services.planner.core.goals.travel import is_constrained

if TYPE_CHECKING:
    from surveilnav.services.planner.core.context import StepContext


def available_frontiers(context: StepContext) -> list[Frontier]:
    """All frontiers that aren't blacklisted, also those that only narrow gaps lead to."""
    return [f for f in context.reach.frontiers if not context.is_blacklisted(f.x_m, f.y_m)]


def split_by_access(context: StepContext) -> tuple[list[Frontier], list[Frontier]]:
    """The available frontiers that can be reached without narrow gaps, and those newly found to be reachable only through them.

    A frontier that was deferred before is in neither, and so is one near a deferred one.
    """
    deferred, near_m = list(context.state.here.deferred_frontiers), context.config.same_place_m
    unconstrained: list[Frontier] = []
    newly_constrained: list[Frontier] = []
    for f in available_frontiers(context):
        if any(math.dist(place, (f.x_m, f.y_m)) < near_m for place in deferred):
            continue
        if is_constrained(context, f.x_m, f.y_m, f.travel_time_m):
            newly_constrained.append(f)
            deferred.append((f.x_m, f.y_m))
        else:
            unconstrained.append(f)
    return unconstrained, newly_constrained


def current_frontier(context: StepContext, frontiers: Sequence[Frontier], within_m: float) -> Frontier | None:
    """The frontier nearest to the one that the robot is heading for; None: none within this distance, or it isn't exploring."""
    waypoint = context.state.waypoint
    if waypoint is None or waypoint.kind != "frontier":
        return None
    return frontier_at((waypoint.x_m, waypoint.y_m), frontiers, within_m)


def frontier_at(place: tuple[float, float], frontiers: Sequence[Frontier], within_m: float) -> Frontier | None:
    """The frontier nearest to a place (x, y) [m]; None: there is none within this distance."""

    def away_m(frontier: Frontier) -> float:
        return math.dist((frontier.x_m, frontier.y_m), place)

    nearest = min(frontiers, key=away_m, default=None)
    return nearest if nearest is not None and away_m(nearest) <= within_m else None
