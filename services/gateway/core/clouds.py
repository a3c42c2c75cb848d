"""The joint cloud for people: at most so many of its points, spread evenly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: The first size of the cubes of which each keeps a point [m]; made larger until they are few enough.
_LEAST_M = 0.04
_FACTOR = 1.2
#: Points farther off than this aren't of a building [m]; a stranger's numbers must not overflow the cubes' keys.
_FARTHEST_M = 10_000.0


def thinned(cloud: NDArray[np.float32], most: int) -> NDArray[np.float32]:
    """(M, 6) of the points (N, 6: x, y, z [m, world], r, g, b [0-1]), M <= ``most``: one in each of the smallest cubes of which
    there are few enough. The same points give the same ones, whatever their order."""
    near = np.all(np.isfinite(cloud), axis=1) & np.all(np.abs(cloud[:, :3]) < _FARTHEST_M, axis=1)
    points = cloud[near]
    points = points[np.lexsort(points.T)]
    size_m = _LEAST_M
    chosen = points
    while len(chosen) > most:
        cells = np.floor(points[:, :3] / size_m).astype(np.int64) + (1 << 20)
        keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
        chosen = points[np.sort(np.unique(keys, return_index=True)[1])]
        size_m *= _FACTOR
    return np.ascontiguousarray(chosen, np.float32)
