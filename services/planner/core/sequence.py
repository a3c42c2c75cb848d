"""In which order to try several options, so that the way until the target is found is expected to be the shortest.

Chance per metre is the best rule for options that lie apart like the ends of spokes. Options behind the same door aren't: having
gone to one, the others are near. So whole orders are compared, exactly, by dynamic programming over the sets of options that
were tried (Held & Karp 1962, https://doi.org/10.1137/0110015, with chances; as a problem of search theory: Stone 1975). It is a
relative of ApexNav's tour (https://arxiv.org/abs/2504.14478), which doesn't weigh chances.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.services.planner.core.choice_rules import highest_utility
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals.travel import NEAR_OBJECT_M, likely_way_m
from surveilnav.services.planner.core.motion.terrain import travel_times_between_m
from surveilnav.services.planner.core.options.option import Option

_IN_SEQUENCE = ("target", "candidate", "frontier")


def least_expected_way(options: Sequence[Option], context: StepContext) -> Option:
    """The first of the order in which the way until the target is found is expected to be the shortest (``expected_way_m``).

    Only objects and frontiers are put in an order, at most ``sequence_options`` of the highest utility. If something else has the
    highest utility of all, that is chosen. The current option is kept unless another order saves ``sequence_margin_m``.
    """
    config, best = context.config, highest_utility(options, context)
    if best.is_accepted or best.kind not in _IN_SEQUENCE:
        return best
    ranked = sorted(options, key=lambda o: (not o.is_current, -o.utility))
    among = [o for o in ranked if o.kind in _IN_SEQUENCE and o.utility > 0.0][: config.sequence_options]
    if len(among) < 2:
        return best
    spend_m = np.array([o.spend_m for o in among])
    first_m = np.array([o.cost_m for o in among]) - spend_m
    way_m = expected_way_m(np.array([o.chance for o in among]), spend_m, first_m, _ways_between(context, among))
    shortest = int(np.argmin(way_m))
    is_kept = among[0].is_current and way_m[0] <= way_m[shortest] + config.sequence_margin_m
    return among[0] if is_kept else among[shortest]


def _ways_between(context: StepContext, options: Sequence[Option]) -> NDArray[np.float64]:
    """(n, n) travel time [m] between options; ``likely_way_m`` where the map shows no way."""
    places = [(o.x_m, o.y_m) for o in options]
    known_m = travel_times_between_m(context.terrain, places, NEAR_OBJECT_M)
    known_m = np.minimum(known_m, known_m.T)  # no way leads out of an object that is all mapped, but one leads there
    apart = np.linalg.norm(np.array(places)[:, None] - np.array(places), axis=2)
    return np.asarray(np.where(np.isfinite(known_m), known_m, likely_way_m(apart)), np.float64)


def expected_way_m(
    chance: NDArray[np.float64],
    spend_m: NDArray[np.float64],
    first_m: NDArray[np.float64],
    between_m: NDArray[np.float64],
) -> NDArray[np.float64]:
    """(n,) the expected way [m] until the target is found, by the option that comes first, the others in the best order.

    A way is travelled only if the target wasn't found before; chances count as independent. What happens if all options are
    in vain is left out, because it is the same for every order.

    Args:
        chance: (n,) that the target is found at each option, 0 to 1; at most 16 options (``sequence_options`` allows 10).
        spend_m: (n,) what is spent there on looking or exploring.
        first_m: (n,) the way from the robot. ``between_m``: (n, n) the way from one (row) to another (column).
    """
    after = _expected_after(chance, spend_m, between_m)
    n = len(chance)
    return np.array([first_m[i] + spend_m[i] + (1.0 - chance[i]) * after[1 << i, i] for i in range(n)])


@njit(cache=True)  # type: ignore[untyped-decorator]
def _expected_after(chance, spend_m, between_m):  # type: ignore[no-untyped-def]
    """(2**n, n) the expected way from option ``i`` on, once the options of the set (a bit for each) were tried in vain."""
    n = len(chance)
    left = np.zeros((1 << n, n))
    for tried in range((1 << n) - 2, 0, -1):  # every set comes after all that contain it
        for i in range(n):
            if not tried >> i & 1:
                continue
            best = np.inf
            for j in range(n):
                if tried >> j & 1:
                    continue
                best = min(best, between_m[i, j] + spend_m[j] + (1.0 - chance[j]) * left[tried | 1 << j, j])
            left[tried, i] = best
    return left
