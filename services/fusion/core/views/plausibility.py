"""Compares a camera's measured depth with the floor that it must see: mistakes of its description are found, and named.

A view whose description is right has many points at its floor's altitude. If a view has hardly any, but has many once one
common mistake is undone (the focal length of another picture size, axes of another convention, millimetres, upside down), that
mistake was made. A view of which nothing fits isn't refused, since it may show no floor, unless much of what it shows lies below
its floor or far above it: nothing in a storey does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core.config import ValidationConfig

_CELLS = 64  # samples across a picture
_MIN_POINTS = 200
#: A mistake explains a view only if so many times as many points are on the floor without it.
_TIMES = 4.0
#: A point is at the floor's altitude within this, plus a share of its depth.
_TOLERANCE_M, _TOLERANCE = 0.05, 0.02
#: A point that is so much lower than the floor lies outside of the storey; also one higher than both of these above the floor.
_BELOW_M, _ABOVE_M, _ABOVE_CAMERA_M = 0.5, 5.0, 2.0
#: Points below the floor may be the floor of a lower storey, seen through an opening, if half of them lie within this height.
#: Then half of all points must be outside.
_LEVEL_M, _HALF = 0.2, 0.5


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
        return _why_outside_storey(sampled, config)
    return (
        f"{100 * as_described:.0f} % of its points are on the floor that it must see, but {100 * best:.0f} % if {what}"
    )


def _why_outside_storey(view: PosedView, config: ValidationConfig) -> str | None:
    """Why what a view shows can't be in its storey; None if it can."""
    height_m = _heights_m(view)[view.depth_m > _TOLERANCE_M]
    below = height_m[height_m < -_BELOW_M]
    share = len(below) / len(height_m)
    if share > max(_HALF, config.outside_storey_share) or (
        share > config.outside_storey_share and not _is_level(below)
    ):
        return (
            f"{100 * share:.0f} % of its points lie more than {_BELOW_M:g} m below its floor, and few on it: its height, its "
            "direction or its floor is another one than stated"
        )
    highest_m = max(_ABOVE_M, view.mounting_offset_m + _ABOVE_CAMERA_M)
    share = float((height_m > highest_m).mean())
    if share > max(_HALF, config.outside_storey_share):
        return (
            f"{100 * share:.0f} % of its points lie more than {highest_m:.1f} m above its floor, and few on it: its height, its "
            "direction or its floor is another one than stated"
        )
    return None


def _is_level(height_m: NDArray[np.float64]) -> bool:
    """Whether half of the points lie at about the same height."""
    ordered, half = np.sort(height_m), len(height_m) // 2
    return bool((ordered[half:] - ordered[: len(ordered) - half]).min() < _LEVEL_M)


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
    on_floor = np.abs(_heights_m(view)) < _TOLERANCE_M + _TOLERANCE * view.depth_m
    near_camera = view.depth_m < _TOLERANCE_M  # such points are everywhere at once
    return float((on_floor & there & ~near_camera).sum() / there.sum())


def _heights_m(view: PosedView) -> NDArray[np.float64]:
    """How high above the floor each pixel's point lies (rows, cols) [m]; without meaning where there is no depth."""
    up = view.camera.rays() @ view.T_world_camera[2, :3]
    return np.asarray(view.mounting_offset_m + up * view.depth_m)


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


def _with_roll(quarters: int) -> Callable[[PosedView], PosedView]:
    """Rolled to the right, as seen from behind the camera, by so many quarters of a turn."""
    cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarters % 4]
    roll = np.array([[cos, -sin, 0, 0], [sin, cos, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], np.float64)
    return lambda view: replace(view, T_world_camera=view.T_world_camera @ roll)


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
    Mistake("it hangs upside down", _with_roll(2)),
    Mistake("it is rolled by 90 degrees to the right, as seen from behind it", _with_roll(1)),
    Mistake("it is rolled by 90 degrees to the left, as seen from behind it", _with_roll(-1)),
)
