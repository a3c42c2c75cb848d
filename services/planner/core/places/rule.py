"""Rates frontiers by what the model expects beyond them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.planner.core.context import RatedFrontier, StepContext
from surveilnav.services.planner.core.goals.frontiers import Frontier
from surveilnav.services.planner.core.places.model import shipped


def by_places(context: StepContext, found: Sequence[Frontier]) -> list[RatedFrontier]:
    """A ``FrontierRule`` by what the model expects beyond.

    A frontier is rated as if it were explored as far as pays best: as far as the chance to find the target is highest for each
    metre that this is expected to take.
    """
    model, robot = shipped(), context.robot
    chances = model.chances(context.maps, (robot.x_m, robot.y_m), found, context.state.target)
    spent_m = expected_way_m(chances, model.within_m)
    rated = []
    for f, chance, beyond_m in zip(found, chances, spent_m, strict=True):
        cost_m = f.travel_time_m + beyond_m
        k = int(np.argmax(chance / cost_m))
        why = f"{100 * chance[k]:.0f} % within {model.within_m[k]:g} m beyond"
        rated.append(RatedFrontier(f, float(chance[k]), float(chance[k] / cost_m[k]), float(cost_m[k]), why))
    return rated


def expected_way_m(chances: NDArray[np.float64], within_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, k) the way [m] that is expected beyond each of n frontiers if it is explored up to a distance, or up to the target.

    Args:
        chances: (n, k), ascending in each row: that the target lies within ``within_m`` (k,). Between two of these distances it
            is as likely anywhere.
    """
    lower_m = np.concatenate([[0.0], within_m[:-1]])
    share = np.diff(chances, axis=1, prepend=0.0)
    found_m = np.cumsum(share * (lower_m + within_m) / 2, axis=1)
    return np.asarray(found_m + (1.0 - chances) * within_m)
