"""Which objects a view has in plain sight and should therefore show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.geometry import inverse
from surveilnav.sensing.views import PosedView

_OCCLUDER_M = 0.15  # what is nearer than the whole object by more than this hides it


def visible_shares(
    view: PosedView, p_world: Sequence[NDArray[np.float64]], near_m: float, far_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How much of each object a view has in plain sight.

    A point is in plain sight if it is in the picture, its depth is between ``near_m`` and ``far_m``, and nothing hides the
    object there. It doesn't matter whether the measured depth agrees with the point or lies behind it: in both cases a
    detector should have found the object.

    Args:
        p_world: for each of K objects, points (N, 3) of it [m, world].

    Returns:
        The share (K,) of each object's points that is in plain sight, and the median pixel (K, 2) of its points in the
        picture; (-1, -1) if none is.
    """
    if not p_world:
        return np.zeros(0), np.zeros((0, 2))
    ends = np.cumsum([len(p) for p in p_world])
    c = view.camera
    return _visible_shares(  # type: ignore[no-any-return]
        np.concatenate(p_world),
        ends,
        inverse(view.T_world_camera)[:3],
        c.fx_px,
        c.fy_px,
        c.cx_px,
        c.cy_px,
        view.depth_m,
        near_m,
        far_m,
    )


@njit(cache=True, nogil=True)
def _visible_shares(points, ends, T, fx, fy, cx, cy, depth_m, near_m, far_m):  # type: ignore[no-untyped-def]
    height, width = depth_m.shape
    shares, pixels = np.zeros(len(ends)), np.full((len(ends), 2), -1.0)
    z, u, v = np.empty(len(points)), np.empty(len(points)), np.empty(len(points))
    begin = 0
    for k, end in enumerate(ends):
        n, nearest = 0, np.inf
        for i in range(begin, end):
            a, b, c = points[i]
            x = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3]
            y = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3]
            ahead = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3]
            if not near_m <= ahead <= far_m or ahead <= 0:
                continue
            column, row = fx * x / ahead + cx, fy * y / ahead + cy
            if 0 <= column <= width - 1 and 0 <= row <= height - 1:
                z[n], u[n], v[n] = ahead, np.round(column), np.round(row)
                nearest = min(nearest, ahead)
                n += 1
        visible = 0
        for i in range(n):
            depth = depth_m[int(v[i]), int(u[i])]
            visible += depth > 0 and depth >= nearest - _OCCLUDER_M
        if n > 0:
            shares[k] = visible / (end - begin)
            pixels[k] = np.median(u[:n]), np.median(v[:n])
        begin = end
    return shares, pixels
