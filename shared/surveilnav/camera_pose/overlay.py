"""Draws a floor plan, a grid and the clicked points into a camera's picture, so that people see whether a pose fits."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_pose.floor_plan import FloorPlan
from surveilnav.geometry import Matrix4
from surveilnav.geometry.lens import Lens

_Points = NDArray[np.float64]
_REACH_M = 20.0  # how far from the camera something is drawn
_PIECE_M = 0.1  # a lens bends lines: they are drawn in pieces of this length
_NEAR_M = 0.1  # nearer to the lens, and behind it, nothing is drawn
_GRID_BGR, _WALL_BGR, _GOOD_BGR, _BAD_BGR = (160, 160, 0), (255, 80, 255), (60, 220, 60), (40, 40, 255)


def draw_overlay(
    picture_bgr: NDArray[np.uint8],
    lens: Lens,
    T_world_camera: Matrix4,
    floor_z_m: float,
    plan: FloorPlan | None = None,
    points_px: NDArray[np.floating] | None = None,
    p_world: NDArray[np.floating] | None = None,
    inliers: NDArray[np.bool_] | None = None,
) -> NDArray[np.uint8]:
    """The picture (height, width, 3) with a grid of 1 m on the floor, the plan's walls, and the points.

    A point is a circle where it was clicked, with its number; an arrow leads to it from where the pose puts it. Points
    that the pose was fitted to are green, the others red.

    Args:
        picture_bgr: of the size of the lens's picture.
        points_px, p_world, inliers: (n, 2), (n, 3) and (n,); None: no points.

    Raises:
        ValueError: the picture has another size.
    """
    height, width = picture_bgr.shape[:2]
    if (width, height) != (lens.pinhole.width_px, lens.pinhole.height_px):
        raise ValueError(f"expected {lens.pinhole.width_px} x {lens.pinhole.height_px} pixels, got {width} x {height}")
    drawn = np.ascontiguousarray(picture_bgr.copy())
    thickness = max(1, round(width / 900))
    draw_lines(drawn, lens, T_world_camera, grid_lines(T_world_camera, floor_z_m), _GRID_BGR, thickness)
    if plan is not None:
        draw_lines(drawn, lens, T_world_camera, wall_lines(plan, floor_z_m), _WALL_BGR, thickness + 1)
    if points_px is not None and p_world is not None:
        fits = np.ones(len(points_px), bool) if inliers is None else inliers
        _draw_points(drawn, points_px, projected(lens, T_world_camera, p_world), fits, thickness)
    return drawn


def grid_lines(T_world_camera: Matrix4, floor_z_m: float) -> list[_Points]:
    """Lines (n, 3) at each whole metre of x and y around the camera, as points of the world."""
    x, y = T_world_camera[:2, 3]
    lines = []
    for axis, middle in enumerate((x, y)):
        for k in range(math.ceil(middle - _REACH_M), math.floor(middle + _REACH_M) + 1):
            along = np.arange(-_REACH_M, _REACH_M + _PIECE_M, _PIECE_M) + (y if axis == 0 else x)
            line = np.full((len(along), 3), floor_z_m)
            line[:, axis], line[:, 1 - axis] = k, along
            lines.append(line)
    return lines


def wall_lines(plan: FloorPlan, floor_z_m: float) -> list[_Points]:
    """The outlines (n, 3) of the plan's dark areas, as points of the world on the floor."""
    if not plan.walls.any():
        return []
    outlines, _ = cv2.findContours(plan.walls.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    step = max(1, int(_PIECE_M / plan.resolution_m))
    lines = []
    for outline in outlines:
        pixels = outline[:, 0, :].astype(np.float64)
        closed = np.concatenate([pixels[::step], pixels[:1]])
        xy = plan.world_of(closed)
        lines.append(np.column_stack([xy, np.full(len(xy), floor_z_m)]))
    return lines


def draw_lines(
    picture: NDArray[np.uint8],
    lens: Lens,
    T_world_camera: Matrix4,
    lines: list[_Points],
    bgr: tuple[int, int, int],
    thickness: int,
) -> None:
    """Draws lines (n, 3) of the world into a picture, as far as the camera sees them. Their points should be close together."""
    for pixels in visible_lines(lens, T_world_camera, lines):
        cv2.polylines(picture, [np.round(16 * pixels).astype(np.int32)], False, bgr, thickness, cv2.LINE_AA, shift=4)


def visible_lines(lens: Lens, T_world_camera: Matrix4, lines: list[_Points]) -> list[_Points]:
    """Lines (n, 3) of the world as lines (m, 2) of pixels (u, v), as far as the camera sees them.

    They may reach up to one picture's size beyond its edges, so that they don't end before them.
    """
    if not lines:
        return []
    p_world = np.concatenate(lines)  # at once: a plan with furniture and lettering has thousands of lines
    pixels = projected(lens, T_world_camera, p_world)
    visible = _in_reach(pixels, lens.pinhole.width_px, lens.pinhole.height_px)
    visible &= np.linalg.norm(p_world[:, :2] - T_world_camera[:2, 3], axis=1) <= _REACH_M
    ends = np.cumsum([len(line) for line in lines])
    return [
        pixels[first + start : first + end]
        for first, last in zip([0, *ends[:-1]], ends, strict=True)
        if visible[first:last].any()
        for start, end in _runs(visible[first:last])
    ]


def projected(lens: Lens, T_world_camera: Matrix4, p_world: NDArray[np.floating]) -> _Points:
    """The pixels (n, 2) of places (n, 3); NaN behind the lens, or too near to it."""
    p_camera = (p_world - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    pixels = lens.pixels(p_camera)
    pixels[np.linalg.norm(p_camera, axis=-1) < _NEAR_M] = np.nan
    return pixels


def _in_reach(pixels: _Points, width: int, height: int) -> NDArray[np.bool_]:
    """Those in the picture or up to one picture beside it."""
    with np.errstate(invalid="ignore"):
        u, v = pixels[:, 0], pixels[:, 1]
        return np.asarray((u > -width) & (u < 2 * width) & (v > -height) & (v < 2 * height))


def _runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Where flags are True, as (start, end) of each stretch of two and more."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 1]


def _draw_points(
    picture: NDArray[np.uint8],
    clicked: NDArray[np.floating],
    predicted: _Points,
    fits: NDArray[np.bool_],
    thickness: int,
) -> None:
    size = 3 * thickness + 3
    for number, (at, from_, fit) in enumerate(zip(clicked, predicted, fits, strict=True), start=1):
        bgr = _GOOD_BGR if fit else _BAD_BGR
        centre = (round(float(at[0])), round(float(at[1])))
        if np.isfinite(from_).all() and np.abs(from_ - at).max() < 4 * max(picture.shape):
            cv2.arrowedLine(
                picture, (round(float(from_[0])), round(float(from_[1]))), centre, bgr, thickness, cv2.LINE_AA
            )
        cv2.circle(picture, centre, size, bgr, thickness, cv2.LINE_AA)
        corner = (centre[0] + size + 2, centre[1] - size)
        for colour, width in (((0, 0, 0), thickness + 2), (bgr, thickness)):
            cv2.putText(
                picture, str(number), corner, cv2.FONT_HERSHEY_SIMPLEX, 0.5 * thickness, colour, width, cv2.LINE_AA
            )
