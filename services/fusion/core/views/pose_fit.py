"""Finds how a camera must have been turned about the vertical, or moved, so that what it measured fits what others measured.

Correlative scan matching (Olson 2009), layer by layer: turning and moving don't change heights, so that points of each layer are
compared with the others' points of that layer. First all turns and shifts are tried in coarse steps, then those around the
best one in fine steps. A correction is only told if it fits clearly better than the description, and than any other place: along
a bare wall, for example, no place is better than the next.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

#: Points so high above the floor are compared: floor and ceiling look the same wherever the camera stands.
_LOW_M, _HIGH_M, _LAYER_M = 0.15, 2.1, 0.15
_MIN_POINTS, _MAX_POINTS, _MAX_RANGE_M = 300, 1500, 6.0
#: Turns and shifts up to these are tried.
_MAX_YAW_RAD, _MAX_SHIFT_M = math.radians(15.0), 1.0
_COARSE_M, _COARSE_RAD = 0.1, math.radians(1.0)
_FINE_M, _FINE_RAD = 0.025, math.radians(0.25)
_TEST_M = 0.05
#: A point so far from the nearest one of the others [m, standard deviation] counts 0.6 of one in the same place.
_COARSE_SIGMA_M, _FINE_SIGMA_M = 0.1, 0.05
#: Farther than so many standard deviations from all others, a point counts nothing.
_FAR_SIGMAS = 5.0
#: Corrections that differ by less are the same.
_SAME_RAD, _SAME_M = math.radians(3.0), 0.3
#: A correction must fit so many times as well as the description, and as the next best, and so well. A healthy camera's points
#: fit by 0.6 to 0.85. Where a robot has seen walls from the other side only, a correction is wrong by their thickness, and fits
#: less.
_TIMES_DESCRIBED, _TIMES_NEXT, _MIN_SCORE = 1.3, 1.05, 0.45


@dataclass(frozen=True, slots=True)
class PoseCorrection:
    """How a camera's description must be changed.

    Attributes:
        yaw_rad: its turn to the left, seen from above.
        x_m, y_m: how it is moved then [world].
        score: how well its points fit then, 0-1.
        described_score: how well they fit by the description.
        next_score: how well they fit by the next best correction.
    """

    yaw_rad: float
    x_m: float
    y_m: float
    score: float
    described_score: float
    next_score: float

    @property
    def is_clear(self) -> bool:
        """Whether it fits so much better than everything else that it can be told."""
        return (
            self.score >= _MIN_SCORE
            and self.score >= _TIMES_DESCRIBED * self.described_score
            and self.score >= _TIMES_NEXT * self.next_score
        )


def points_to_fit(
    p_world: NDArray[np.float64], p_camera: NDArray[np.float64], floor_z_m: float, max_points: int = _MAX_POINTS
) -> NDArray[np.float64]:
    """Of the points (N, 3) that a camera has measured, those that ``fit_pose`` compares [m, world]."""
    near = np.linalg.norm(p_world[:, :2] - p_camera[:2], axis=1) < _MAX_RANGE_M
    points = _between(p_world[near], floor_z_m)
    chosen: NDArray[np.float64] = points[
        np.linspace(0, len(points) - 1, min(len(points), max_points)).round().astype(int)
    ]
    return chosen


def fit_pose(
    mine: NDArray[np.float64], others: NDArray[np.float64], p_camera: NDArray[np.float64], floor_z_m: float
) -> PoseCorrection | None:
    """The turn about the camera and the shift by which its points fit those of others best; None if there are too few points.

    The same points give the same result.

    Args:
        mine: ``points_to_fit`` of the camera.
        others: (M, 3) points that others have measured [m, world].
        p_camera: (2,) where the camera stands by its description [m, world].
    """
    p, reach_m = p_camera[:2], _MAX_RANGE_M + 2 * _MAX_SHIFT_M
    others = _between(others[(np.abs(others[:, :2] - p) < reach_m).all(axis=1)], floor_z_m)
    if min(len(mine), len(others)) < _MIN_POINTS:
        return None
    coarse = _Layers(others, p, reach_m, floor_z_m, _COARSE_M, _COARSE_SIGMA_M)
    yaws = np.arange(-_MAX_YAW_RAD, _MAX_YAW_RAD + 1e-9, _COARSE_RAD)
    scores = coarse.scores(mine, yaws, 0, 0, round(_MAX_SHIFT_M / _COARSE_M))
    k, i, j = np.unravel_index(int(np.argmax(scores)), scores.shape)
    middle = scores.shape[1] // 2
    yaw_rad, y_m, x_m = float(yaws[k]), (i - middle) * _COARSE_M, (j - middle) * _COARSE_M
    shifts_m = (np.arange(scores.shape[1]) - middle) * _COARSE_M
    elsewhere = (
        (np.abs(yaws - yaw_rad) >= _SAME_RAD)[:, None, None]
        | (np.abs(shifts_m - y_m) >= _SAME_M)[None, :, None]
        | (np.abs(shifts_m - x_m) >= _SAME_M)[None, None, :]
    )
    next_share = float(scores[elsewhere].max()) / max(float(scores[k, i, j]), 1e-9)
    near = np.asarray(yaw_rad + np.arange(-4, 5) * _FINE_RAD, np.float64)
    n_y, n_x, n = round(y_m / _FINE_M), round(x_m / _FINE_M), round(1.5 * _COARSE_M / _FINE_M)
    box = _box(mine, p, np.append(near, 0.0), max(abs(n_y), abs(n_x)) * _FINE_M + n * _FINE_M)
    fine = _Layers(_near_box(others, box, _FINE_SIGMA_M), p, reach_m, floor_z_m, _FINE_M, _FINE_SIGMA_M)
    fine_scores = fine.scores(mine, near, n_y, n_x, n)
    a, b, c = np.unravel_index(int(np.argmax(fine_scores)), fine_scores.shape)
    half, score = fine_scores.shape[1] // 2, float(fine_scores[a, b, c])
    return PoseCorrection(
        yaw_rad=float(near[a]),
        x_m=(n_x + int(c) - half) * _FINE_M,
        y_m=(n_y + int(b) - half) * _FINE_M,
        score=score,
        described_score=float(fine.scores(mine, np.zeros(1), 0, 0, 0)[0, 0, 0]),
        next_score=next_share * score,
    )


def score_poses(
    mine: NDArray[np.float64],
    others: NDArray[np.float64],
    p_camera: NDArray[np.float64],
    floor_z_m: float,
    poses: Sequence[tuple[float, float, float]],
) -> list[float]:
    """How well points fit those of others (0-1), turned about a place and shifted in some given ways: yaw [rad], x and y [m].

    It is more tolerant than ``fit_pose``, since a correction that others have found is never exact.
    """
    layers = _Layers(others, p_camera[:2], _MAX_RANGE_M + 2 * _MAX_SHIFT_M, floor_z_m, _TEST_M, _COARSE_SIGMA_M)
    return [
        float(layers.scores(mine, np.array([yaw]), round(y_m / _TEST_M), round(x_m / _TEST_M), 0)[0, 0, 0])
        for yaw, x_m, y_m in poses
    ]


def _turned(points: NDArray[np.float64], p: NDArray[np.float64], yaw_rad: float) -> NDArray[np.float64]:
    """(N, 2) of points (N, 3) turned about p (2,), from there."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    turned: NDArray[np.float64] = (points[:, :2] - p) @ np.array([[cos, sin], [-sin, cos]])
    return turned


def _box(
    points: NDArray[np.float64], p: NDArray[np.float64], yaws: NDArray[np.float64], shift_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The corners (2,) of the box in which points (N, 3) stay if they are turned about p by some yaws and shifted by up to
    ``shift_m`` along x and y [m, world]."""
    turned = [_turned(points, p, float(yaw)) for yaw in yaws]
    low, high = np.min([t.min(axis=0) for t in turned], axis=0), np.max([t.max(axis=0) for t in turned], axis=0)
    return p + low - shift_m, p + high + shift_m


def _near_box(
    others: NDArray[np.float64], box: tuple[NDArray[np.float64], NDArray[np.float64]], sigma_m: float
) -> NDArray[np.float64]:
    """Those of others (M, 3) that are near enough to a box to count for points in it, rounded to cells."""
    margin_m = (_FAR_SIGMAS + 1.0) * sigma_m
    return others[((others[:, :2] >= box[0] - margin_m) & (others[:, :2] <= box[1] + margin_m)).all(axis=1)]


def _between(points: NDArray[np.float64], floor_z_m: float) -> NDArray[np.float64]:
    height_m = points[:, 2] - floor_z_m
    return points[(height_m >= _LOW_M) & (height_m < _HIGH_M)]


class _Layers:
    """Pictures of how near each place is to the others' points, one for each layer of height."""

    def __init__(
        self,
        others: NDArray[np.float64],
        p: NDArray[np.float64],
        reach_m: float,
        floor_z_m: float,
        cell_m: float,
        sigma_m: float,
    ) -> None:
        self._p, self._cell_m, self._floor_z_m = p, cell_m, floor_z_m
        self._middle = math.ceil(reach_m / cell_m) + 1
        side = 2 * self._middle + 1
        n_layers = math.ceil((_HIGH_M - _LOW_M) / _LAYER_M)
        self._near = np.zeros((n_layers, side, side), np.float32)
        layer, row, col = self._cells(others[:, :2] - p, others[:, 2])
        inside = (row >= 0) & (row < side) & (col >= 0) & (col < side)
        layer, row, col = layer[inside], row[inside], col[inside]
        if not len(layer):
            return
        # only around the others' points, because everything else is far from all of them
        margin = math.ceil(_FAR_SIGMAS * sigma_m / cell_m)
        rows, cols = (slice(max(0, c.min() - margin), c.max() + margin + 1) for c in (row, col))
        empty = np.ones((n_layers, side, side), np.uint8)
        empty[layer, row, col] = 0
        for k in np.unique(layer):
            d_m = cv2.distanceTransform(empty[k, rows, cols], cv2.DIST_L2, cv2.DIST_MASK_5) * cell_m
            near = d_m < _FAR_SIGMAS * sigma_m
            self._near[k, rows, cols][near] = np.exp(-0.5 * (d_m[near] / sigma_m) ** 2)

    def _cells(
        self, offset_m: NDArray[np.float64], z_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        layer = ((z_m - self._floor_z_m - _LOW_M) / _LAYER_M).astype(np.int64).clip(0, len(self._near) - 1)
        col, row = (np.floor(offset_m / self._cell_m + 0.5).astype(np.int64) + self._middle).T
        return layer, row, col

    def scores(
        self, mine: NDArray[np.float64], yaws: NDArray[np.float64], row0: int, col0: int, n: int
    ) -> NDArray[np.float64]:
        """How near points are to the others' on average (0-1), once turned and shifted: (yaws, 2 n + 1, 2 n + 1).

        Args:
            row0, col0: the middle of the shifts along y and x, in cells; ``n`` more in each direction are tried.
        """
        out = np.empty((len(yaws), 2 * n + 1, 2 * n + 1))
        for k, yaw in enumerate(yaws):
            layer, row, col = self._cells(_turned(mine, self._p, float(yaw)), mine[:, 2])
            out[k] = _mean_around(self._near, layer, row + row0, col + col0, n)
        return out


@njit(cache=True)  # type: ignore[untyped-decorator]
def _mean_around(near, layer, row, col, n):  # type: ignore[no-untyped-def]
    """(2 n + 1, 2 n + 1) the mean over cells of ``near`` (layers, side, side), shifted by up to n along rows and columns; cells
    outside count as those at the edge."""
    side, width = near.shape[1], 2 * n + 1
    total = np.zeros((width, width), np.float32)
    for p in range(len(layer)):
        inside = n <= row[p] < side - n and n <= col[p] < side - n
        for i in range(width):
            sums, r = total[i], min(max(row[p] + i - n, 0), side - 1)
            if inside:  # a slice, so that the compiler adds several at a time: twice as fast
                seen = near[layer[p], r, col[p] - n : col[p] + n + 1]
                for j in range(width):
                    sums[j] += seen[j]
            else:
                for j in range(width):
                    sums[j] += near[layer[p], r, min(max(col[p] + j - n, 0), side - 1)]
    return total / len(layer)
