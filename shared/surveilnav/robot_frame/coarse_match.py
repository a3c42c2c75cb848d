"""The coarse part of matching two maps: all turns in steps, and for each of them all shifts at once."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.robot_frame.map_side import WEIGHT, MapSide, is_same
from surveilnav.robot_frame.planar import PlanarTransform

_Array = NDArray[np.float64]
_Layer = NDArray[np.float32]
#: Side of a cell, at least; in larger maps cells grow, so that it takes no longer.
_CELL_M, _MAX_CELLS = 0.2, 256
_YAW_STEP_RAD = math.radians(1.5)
#: Distance to the next obstacle [m, standard deviation] at which a place counts 0.6 of one in the same place.
_SIGMA_M = 0.2
_PEAKS_PER_YAW, _MAX_RESULTS = 4, 30


def coarse_matches(
    own: MapSide,
    joint: MapSide,
    pivot: _Array,
    near: PlanarTransform | None,
    within_m: float,
    within_rad: float,
) -> list[PlanarTransform]:
    """The transforms that gain most in coarse steps, and that differ from each other."""
    radius_m = float(np.linalg.norm(own.obstacles - pivot, axis=1).max())
    rows, cols = joint.is_known.shape
    largest_m = max(rows * joint.cell_m, cols * joint.cell_m, 2 * radius_m)
    cell_m = max(_CELL_M, largest_m / _MAX_CELLS)
    sigma_m = _SIGMA_M * cell_m / _CELL_M
    coarse_joint = _Coarse.from_side(joint, cell_m, sigma_m)
    half = math.ceil(radius_m / cell_m) + 1
    side = 2 * half + 1
    shape = tuple(_fast_size(n + side) for n in coarse_joint.field.shape)
    F_field, F_obstacles = (np.fft.rfft2(a, shape) for a in (coarse_joint.field, coarse_joint.obstacles))
    own_field = own.field(sigma_m)
    yaws = np.arange(0.0, 2 * math.pi, _YAW_STEP_RAD)
    if near is not None:
        turned = np.abs(np.remainder(yaws - near.yaw_rad + math.pi, 2 * math.pi) - math.pi)
        yaws = yaws[turned <= within_rad + _YAW_STEP_RAD / 2]
    found: list[tuple[float, PlanarTransform]] = []
    for yaw_rad in yaws:
        turn = PlanarTransform(0.0, 0.0, float(yaw_rad))
        obstacles, field = _turned(own, own_field, pivot, turn, half, cell_m)
        G = (
            np.conj(np.fft.rfft2(obstacles, shape)) * F_field
            + WEIGHT * np.conj(np.fft.rfft2(field, shape)) * F_obstacles
        )
        gain = np.fft.irfft2(G, shape).astype(np.float32)
        for value, row, col in _peaks(gain):
            # cell (row, col): where the corner of the robot's picture comes to lie, beyond the middle: negative
            row, col = (i - n if i >= n - side else i for i, n in ((row, shape[0]), (col, shape[1])))
            p = coarse_joint.corner + (np.array([col, row]) + half + 0.5) * cell_m  # where the pivot comes to lie
            x, y = p - turn.apply(pivot)
            T = PlanarTransform(float(x), float(y), float(yaw_rad))
            if near is None or T.difference(near, pivot)[0] <= within_m + cell_m:
                found.append((value, T))
    found.sort(key=lambda item: -item[0])
    chosen: list[PlanarTransform] = []
    for _, T in found:
        if all(not is_same(T, other, pivot, 0.5) for other in chosen):
            chosen.append(T)
            if len(chosen) == _MAX_RESULTS:
                break
    return chosen


@dataclass(frozen=True, slots=True, eq=False)
class _Coarse:
    """The joint map in coarse cells: its field and its obstacles (0 or 1), and the corner of cell (0, 0) [m, building]."""

    field: _Layer
    obstacles: _Layer
    corner: _Array

    @classmethod
    def from_side(cls, joint: MapSide, cell_m: float, sigma_m: float) -> _Coarse:
        corner = np.array([joint.T_frame_cells.x_m, joint.T_frame_cells.y_m])
        rows, cols = (math.ceil(n * joint.cell_m / cell_m) for n in joint.is_known.shape)
        centres = corner + (np.mgrid[:rows, :cols].transpose(1, 2, 0)[..., ::-1] + 0.5) * cell_m
        field = joint.sample(joint.field(sigma_m), centres.reshape(-1, 2)).reshape(rows, cols)
        return cls(field, _splat(joint.obstacles - corner, cell_m, rows, cols), corner)


def _turned(
    own: MapSide, field: _Layer, pivot: _Array, turn: PlanarTransform, half: int, cell_m: float
) -> tuple[_Layer, _Layer]:
    """The robot's obstacles (0 or 1) and field in coarse cells (2 half + 1, ditto), turned; the pivot in the middle."""
    n = 2 * half + 1
    middle_m = (half + 0.5) * cell_m
    obstacles = _splat(turn.apply(own.obstacles - pivot) + middle_m, cell_m, n, n)
    # pixel of the coarse picture -> pixel of the field
    T = own.T_frame_cells.inverse() @ PlanarTransform(*pivot) @ turn.inverse() @ PlanarTransform(-middle_m, -middle_m)
    scale = cell_m / own.cell_m
    A = np.empty((2, 3))
    A[:, :2] = T.rotation() * scale
    A[:, 2] = (np.array([T.x_m, T.y_m]) / own.cell_m) + A[:, :2] @ (0.5, 0.5) - 0.5
    turned = cv2.warpAffine(field, A, (n, n), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderValue=0.0)
    return obstacles, np.asarray(turned, np.float32)


def _splat(p: _Array, cell_m: float, rows: int, cols: int) -> _Layer:
    """1 in the cells that places (n, 2) [m] lie in, else 0."""
    col, row = np.floor(p / cell_m).astype(np.int64).T
    inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    out = np.zeros((rows, cols), np.float32)
    out[row[inside], col[inside]] = 1.0
    return out


def _peaks(gain: _Layer) -> list[tuple[float, int, int]]:
    """The largest local maxima: value, row and column."""
    highest = cv2.dilate(gain, np.ones((5, 5), np.uint8))
    rows, cols = np.nonzero((gain == highest) & (gain > 0.25 * gain.max()) & (gain > 0))
    best = np.argsort(-gain[rows, cols], kind="stable")[:_PEAKS_PER_YAW]
    return [(float(gain[rows[i], cols[i]]), int(rows[i]), int(cols[i])) for i in best]


def _fast_size(n: int) -> int:
    """The next size whose Fourier transform is fast: 2^a 3^b 5^c."""
    while True:
        rest = n
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return n
        n += 1
