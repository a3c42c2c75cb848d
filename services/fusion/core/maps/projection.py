"""Projection of views: from depth pictures to points in the world, and from points to ranges by azimuth. Compiled."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4
from surveilnav.sensing.views import PosedView

#: Number of azimuth bins in a view's ranges, one per degree.
AZIMUTHS = 360


def sample_stride(width_px: int, height_px: int, n_points: int) -> int:
    """The stride along rows and columns that samples about ``n_points`` pixels of a picture."""
    return max(1, round(math.sqrt(width_px * height_px / n_points)))


def world_points(
    view: PosedView, n_points: int, max_range_m: float, edge: float
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Back-projects about ``n_points`` pixels of a view: points (N, 3) float32 [m, world] and their colours (N, 3) uint8.

    Left out are pixels without a depth (NaN, 0), those out of range, and flying pixels, whose depth differs from both neighbours
    in their row or in their column by more than the share ``edge`` of it.
    """
    camera = view.camera
    stride = sample_stride(camera.width_px, camera.height_px, n_points)
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
    max_points = ((height + stride - 1) // stride) * ((width + stride - 1) // stride)
    points = np.empty((max_points, 3), np.float32)
    colours = np.empty((max_points, 3), np.uint8)
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


def azimuth_ranges(
    p_world: NDArray[np.float32], p_camera_m: NDArray[np.float64], ceiling_z_m: float, lowest_z_m: float = -math.inf
) -> NDArray[np.float32]:
    """The horizontal ranges in which a view's rays run between two altitudes, by azimuth, like those of a 2D laser scanner.

    Bin k covers azimuths of [k, k + 1) degrees around the camera's (x, y), anticlockwise from the world's +x. An empty bin
    between two others gets the range on which both agree.

    Args:
        p_world: (N, 3) points of the view, the ends of its rays [m, world].
        p_camera_m: (3,) position of its camera [m, world].
        ceiling_z_m, lowest_z_m: the altitudes [m, world].

    Returns:
        (360, 2) float32: nearest and farthest distance [m] from the camera; (0, 0) where no ray runs.
    """
    return _azimuth_ranges(p_world, *p_camera_m, ceiling_z_m, lowest_z_m)  # type: ignore[no-any-return]


@njit(cache=True, nogil=True)
def _azimuth_ranges(p_world, cx, cy, cz, ceiling_z, lowest_z):  # type: ignore[no-untyped-def]
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
    bridged = out.copy()
    for k in range(AZIMUTHS):
        before, after = out[(k - 1) % AZIMUTHS], out[(k + 1) % AZIMUTHS]
        if out[k, 1] == 0.0 and before[1] > 0.0 and after[1] > 0.0:
            start, end = max(before[0], after[0]), min(before[1], after[1])
            if end > start:
                bridged[k, 0], bridged[k, 1] = start, end
    return bridged


def covered_box(ranges_m: NDArray[np.floating]) -> tuple[float, float, float, float]:
    """The box (x_min, y_min, x_max, y_max) [m] that ranges by azimuth (360, 2) cover, relative to the camera."""
    edges = np.arange(AZIMUTHS + 1) * (2 * math.pi / AZIMUTHS)
    end_m = np.maximum(ranges_m[:, 1], np.roll(ranges_m[:, 1], 1)).astype(np.float64)
    end_m = np.append(end_m, end_m[0])  # at each edge between two bins, the farther of the two
    x, y = end_m * np.cos(edges) * 1.001, end_m * np.sin(edges) * 1.001  # an arc bulges beyond its chord
    return min(0.0, x.min()), min(0.0, y.min()), max(0.0, x.max()), max(0.0, y.max())


@njit(cache=True, nogil=True)
def azimuth_bins(ranges_m, cx, cy, resolution_m, row0, col0, rows, cols):  # type: ignore[no-untyped-def]
    """The azimuth bin whose range covers each cell of a window: (rows, cols) int16, -1 where none does."""
    out = np.full((rows, cols), -1, np.int16)
    for row in range(rows):
        dy = (row0 + row + 0.5) * resolution_m - cy
        for col in range(cols):
            dx = (col0 + col + 0.5) * resolution_m - cx
            k = int((math.atan2(dy, dx) / (2 * math.pi) + 1.0) * AZIMUTHS) % AZIMUTHS
            if ranges_m[k, 1] > 0.0:
                r = math.sqrt(dx * dx + dy * dy)
                if ranges_m[k, 0] <= r <= ranges_m[k, 1]:
                    out[row, col] = k
    return out


def camera_position(T_world_camera: Matrix4) -> NDArray[np.float64]:
    """The camera's position (3,) [m, world]."""
    return np.ascontiguousarray(T_world_camera[:3, 3], dtype=np.float64)
