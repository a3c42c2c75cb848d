"""Compares a camera's measured depth with the floor that it must see: mistakes of its description are found, and named.

A view whose description is right has many points at its floor's altitude. If a view has hardly any, but has many once one
common mistake is undone (the focal length of another picture size, axes of another convention, millimetres), that
mistake was made. A view of which nothing fits isn't refused: perhaps it shows no floor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from surveilnav.geometry import Pinhole
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core.config import ValidationConfig

_CELLS = 64  # samples across a picture
_MIN_POINTS = 200
#: A mistake explains a view only if so many times as many points are on the floor without it.
_TIMES = 4.0
#: A point is at the floor's altitude within this, plus a share of its depth.
_TOLERANCE_M, _TOLERANCE = 0.05, 0.02


@dataclass(frozen=True, slots=True)
class Mistake:
    """A mistake in the description of a camera: what it is, and a view with the mistake undone."""

    what: str
    undo: Callable[[PosedView], PosedView]


def find_mistake(view: PosedView, config: ValidationConfig) -> str | None:
    """The mistake in the description of a camera with a depth sensor, in words; None if none can be told."""
    if view.is_robot or view.depth_source != "sensor":
        return None
    sampled = _sampled(view)
    as_described = _share_on_floor(sampled)
    if as_described is None or as_described >= config.floor_share:
        return None
    shares = [(_share_on_floor(mistake.undo(sampled)) or 0.0, mistake.what) for mistake in _MISTAKES]
    best, what = max(shares)
    if best < max(config.corrected_floor_share, _TIMES * as_described):
        return None
    return (
        f"{100 * as_described:.0f} % of its points are on the floor that it must see, but {100 * best:.0f} % if {what}"
    )


def _sampled(view: PosedView) -> PosedView:
    """The view with every n-th pixel, and its lens accordingly."""
    step = max(1, view.camera.width_px // _CELLS)
    depth_m = view.depth_m[::step, ::step]
    c, (height, width) = view.camera, depth_m.shape
    lens = Pinhole(width, height, c.fx_px / step, c.fy_px / step, c.cx_px / step, c.cy_px / step)
    return replace(view, depth_m=depth_m, camera=lens)


def _share_on_floor(view: PosedView) -> float | None:
    """The share of a view's points that are at its floor's altitude; None if it has too few points."""
    there = view.depth_m > 0
    if np.count_nonzero(there) < _MIN_POINTS:
        return None
    up = view.camera.rays() @ view.T_world_camera[2, :3]
    height_m = view.mounting_offset_m + up * view.depth_m
    on_floor = np.abs(height_m) < _TOLERANCE_M + _TOLERANCE * view.depth_m
    near_camera = view.depth_m < _TOLERANCE_M  # such points are everywhere at once
    return float((on_floor & there & ~near_camera).sum() / there.sum())


def _with_focal_length(factor: float) -> Callable[[PosedView], PosedView]:
    def undo(view: PosedView) -> PosedView:
        c = view.camera
        return replace(
            view, camera=Pinhole(c.width_px, c.height_px, c.fx_px * factor, c.fy_px * factor, c.cx_px, c.cy_px)
        )

    return undo


def _with_depth(factor: float) -> Callable[[PosedView], PosedView]:
    return lambda view: replace(view, depth_m=view.depth_m * np.float32(factor))


def _with_axes_turned(view: PosedView) -> PosedView:
    T = view.T_world_camera.copy()
    T[:3, 1:3] *= -1.0
    return replace(view, T_world_camera=T)


_MISTAKES = (
    *(
        Mistake(
            f"its focal length is {factor:g} times what is stated: was it given for pictures of another size?",
            _with_focal_length(factor),
        )
        for factor in (0.5, 0.75, 4 / 3, 2.0)
    ),
    Mistake("its depth is in millimetres, not in metres", _with_depth(0.001)),
    Mistake("its depth is in kilometres, or was divided by 1,000 twice", _with_depth(1000.0)),
    Mistake(
        "the y and z axes of its pose are turned: ours point down and forwards, as OpenCV's do, not as OpenGL's",
        _with_axes_turned,
    ),
)
