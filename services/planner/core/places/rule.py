"""Rates frontiers by what the model expects beyond them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.planner.core.context import RatedFrontier, StepContext
from surveilnav.services.planner.core.goals.frontiers import Frontier, weight_by_hidden
from surveilnav.services.planner.core.places.model import shipped


def by_places(context: StepContext, found: Sequence[Frontier]) -> list[RatedFrontier]:
    """A ``FrontierRule``: the frontier over which the way to the target is expected to be the shortest.

    Its utility is ``places_certainty`` for each metre of this way, so that it can be compared with those of objects; less where a
    map from before knows that little is hidden.
    """
    model, robot, certainty = shipped(), context.robot, context.config.places_certainty
    chances = model.chances(context.maps, (robot.x_m, robot.y_m), found, context.state.target)
    rated = []
    for f, beyond_m in zip(found, expected_way_m(chances, model.within_m), strict=True):
        cost_m = f.travel_time_m + float(beyond_m)
        chance = certainty * weight_by_hidden(f)
        rated.append(RatedFrontier(f, chance, chance / cost_m, cost_m, f"{beyond_m:.1f} m expected beyond"))
    return rated


def expected_way_m(chances: NDArray[np.float64], within_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) the way [m] to the target that is expected beyond each of n frontiers.

    Args:
        chances: (n, k), ascending in each row: that the target lies within ``within_m`` (k,). Between two of these distances it
            is as likely anywhere; if it is farther than the last one, 1.5 times that counts.
    """
    edges_m = np.concatenate([[0.0], within_m, [2.0 * within_m[-1]]])
    share = np.diff(chances, axis=1, prepend=0.0, append=1.0)
    return np.asarray(share @ (edges_m[1:] + edges_m[:-1]) / 2)
