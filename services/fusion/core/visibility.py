"""Should this view show that object?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import inverse, transform_points
from surveilnav.sensing.views import PosedView

_SAMPLES = 64
_OCCLUDER_M = 0.15  # something this much nearer than all of the object hides it


def in_plain_view(
    view: PosedView, p_world: NDArray[np.float64], near_m: float, far_m: float
) -> tuple[float, tuple[float, float]]:
    """Share of points (N, 3) [m, world] that a view has in its picture, within range, with nothing before the object.

    Depth that agrees and depth that looks through both count: either way the object's class should have been seen
    there. Also returns the pixel (u, v) of the points' middle, (-1, -1) if none is in view.
    """
    every = np.linspace(0, len(p_world) - 1, min(len(p_world), _SAMPLES)).round().astype(int)
    p_camera = transform_points(inverse(view.T_world_camera), p_world[every])
    uv = view.camera.project(p_camera)
    z = p_camera[:, 2]
    height, width = view.depth_m.shape
    with np.errstate(invalid="ignore"):
        inside = (z >= near_m) & (z <= far_m) & np.all((uv >= 0) & (uv <= (width - 1, height - 1)), axis=1)
    if not inside.any():
        return 0.0, (-1.0, -1.0)
    u, v = uv[inside].round().astype(int).T
    depth_m = view.depth_m[v, u]
    with np.errstate(invalid="ignore"):
        clear = (depth_m > 0) & (depth_m >= z[inside].min() - _OCCLUDER_M)
    return float(np.count_nonzero(clear)) / len(every), (float(np.median(u)), float(np.median(v)))
