"""From a depth picture to points in the world, compiled: the inner loops of fusion."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4
from surveilnav.sensing.views import PosedView

#: Directions that a view's reach is kept for, one per degree.
AZIMUTHS = 360


def sample_stride(width_px: int, height_px: int, wanted: int) -> int:
    """Every how many-th pixel of a picture to take for about ``wanted`` of them."""
    return max(1, round(math.sqrt(width_px * height_px / wanted)))


def world_points(
    view: PosedView, wanted: int, max_range_m: float, edge: float
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Subsampled points (N, 3) float32 [m, world] and their colours (N, 3) uint8.

    NaN, 0, out of range and flying pixels (which differ from both neighbours of a row or a column by more than
    the share ``edge`` of their depth) are left out.
    """
    camera = view.camera
    stride = sample_stride(camera.width_px, camera.height_px, wanted)
    T = np.ascontiguousarray(view.T_world_camera, dtype=np.float64)
    near_m, far_m = view.depth_range_m
    return _world_points(  # type: ignore[no-any-return]
        np.ascontiguousarray(view.depth_m, dtype=np.float32),
        np.ascontiguousarray(view.rgb),
        T,
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        stride,
        near_m,
        min(far_m, max_range_m),
        edge,
    )


@njit(cache=True, nogil=True)
def _world_points(depth_m, rgb, T, fx, fy, cx, cy, stride, near_m, far_m, edge):  # type: ignore[no-untyped-def]
    height, width = depth_m.shape
    most = ((height + stride - 1) // stride) * ((width + stride - 1) // stride)
    points = np.empty((most, 3), np.float32)
    colours = np.empty((most, 3), np.uint8)
    n = 0
    for v in range(stride // 2, height, stride):
        for u in range(stride // 2, width, stride):
            d = depth_m[v, u]
            if not (d > 0.0 and d >= near_m and d < far_m):  # also drops NaN
                continue
            if 0 < u < width - 1 and 0 < v < height - 1:
                limit = edge * d
                left, right = abs(depth_m[v, u - 1] - d), abs(depth_m[v, u + 1] - d)
                above, below = abs(depth_m[v - 1, u] - d), abs(depth_m[v + 1, u] - d)
                if (left > limit and right > limit) or (above > limit and below > limit):
                    continue
            x, y = (u - cx) / fx * d, (v - cy) / fy * d
            for k in range(3):
                points[n, k] = T[k, 0] * x + T[k, 1] * y + T[k, 2] * d + T[k, 3]
                colours[n, k] = rgb[v, u, k]
            n += 1
    return points[:n].copy(), colours[:n].copy()


def reach(
    p_world: NDArray[np.float32], p_camera_m: NDArray[np.float64], ceiling_z_m: float, lowest_z_m: float = -math.inf
) -> NDArray[np.float32]:
    """How far a view's rays run between ``lowest_z_m`` and ``ceiling_z_m``, by azimuth: (360, 2) float32 of (from, to) [m].

    Azimuth bin k covers [k, k + 1) degrees from +x of the world, anticlockwise, around the camera's (x, y).
    (0, 0) where no ray runs. A single empty bin between two full ones is bridged by what both agree on.
    """
    return _reach(p_world, *p_camera_m, ceiling_z_m, lowest_z_m)  # type: ignore[no-any-return]


@njit(cache=True, nogil=True)
def _reach(p_world, cx, cy, cz, ceiling_z, lowest_z):  # type: ignore[no-untyped-def]
    out = np.zeros((AZIMUTHS, 2), np.float32)
    for i in range(p_world.shape[0]):
        dx, dy, z = p_world[i, 0] - cx, p_world[i, 1] - cy, p_world[i, 2]
        r = math.sqrt(dx * dx + dy * dy)
        start, end = 0.0, r
        if cz > ceiling_z:
            if z >= ceiling_z:
                continue
            start = r * (cz - ceiling_z) / (cz - z)
        elif z > ceiling_z:
            end = r * (ceiling_z - cz) / (z - cz)
        if z < lowest_z:
            end = r * max(0.0, cz - lowest_z) / (cz - z)
        if end <= 0.0:
            continue
        k = int((math.atan2(dy, dx) / (2 * math.pi) + 1.0) * AZIMUTHS) % AZIMUTHS
        if out[k, 1] == 0.0:
            out[k, 0], out[k, 1] = start, end
        else:
            out[k, 0], out[k, 1] = min(out[k, 0], start), max(out[k, 1], end)
    filled = out.copy()
    for k in range(AZIMUTHS):
        before, after = out[(k - 1) % AZIMUTHS], out[(k + 1) % AZIMUTHS]
        if out[k, 1] == 0.0 and before[1] > 0.0 and after[1] > 0.0:
            start, end = max(before[0], after[0]), min(before[1], after[1])
            if end > start:
                filled[k, 0], filled[k, 1] = start, end
    return filled


def extent(reach_m: NDArray[np.floating]) -> tuple[float, float, float, float]:
    """(x_min, y_min, x_max, y_max) [m] of what a reach (360, 2) covers, relative to its camera."""
    edges = np.arange(AZIMUTHS + 1) * (2 * math.pi / AZIMUTHS)
    end_m = np.maximum(reach_m[:, 1], np.roll(reach_m[:, 1], 1)).astype(np.float64)
    end_m = np.append(end_m, end_m[0])  # at each edge between two bins, the farther of both
    x, y = end_m * np.cos(edges) * 1.001, end_m * np.sin(edges) * 1.001  # a bin bulges past the chord of its edges
    return min(0.0, x.min()), min(0.0, y.min()), max(0.0, x.max()), max(0.0, y.max())


@njit(cache=True, nogil=True)
def azimuth_bins(reach_m, cx, cy, resolution_m, row0, col0, rows, cols):  # type: ignore[no-untyped-def]
    """The azimuth bin whose reach covers a cell, -1 where none does: (rows, cols) int16 of a window of world cells."""
    out = np.full((rows, cols), -1, np.int16)
    for row in range(rows):
        dy = (row0 + row + 0.5) * resolution_m - cy
        for col in range(cols):
            dx = (col0 + col + 0.5) * resolution_m - cx
            k = int((math.atan2(dy, dx) / (2 * math.pi) + 1.0) * AZIMUTHS) % AZIMUTHS
            if reach_m[k, 1] > 0.0:
                r = math.sqrt(dx * dx + dy * dy)
                if reach_m[k, 0] <= r <= reach_m[k, 1]:
                    out[row, col] = k
    return out


def camera_position(T_world_camera: Matrix4) -> NDArray[np.float64]:
    """(3,) [m, world]."""
    return np.ascontiguousarray(T_world_camera[:3, 3], dtype=np.float64)
