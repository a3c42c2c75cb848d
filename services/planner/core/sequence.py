"""In which order to try several options, so that the way until the target is found is expected to be the shortest.

Chance per metre is the best rule for options that lie apart like the ends of spokes. Options behind the same door aren't: having
gone to one, the others are near. So whole orders are compared, exactly, by dynamic programming over the sets of options that
were tried (Held & Karp 1962, https://doi.org/10.1137/0110015, with chances; as a problem of search theory: Stone 1975). It is a
relative of ApexNav's tour (https://arxiv.org/abs/2504.14478), which doesn't weigh chances.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


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
        chance: (n,) that the target is found at each option, 0 to 1; at most 16 options.
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
