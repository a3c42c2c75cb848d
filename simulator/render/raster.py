"""What a pinhole camera sees first, by z-buffer: several times faster than a ray per pixel.

Homogeneous rasterisation (Olano & Greer 1997, "Triangle scan conversion using 2D homogeneous coordinates"): with
corners a, b, c in the camera frame and a ray d = (x, y, 1), the three determinants d.(b x c), d.(c x a), d.(a x b) are
linear in the pixel, have one sign inside the triangle, and give barycentric weights and depth exactly; nothing has to
be clipped. Edges that triangles share evaluate to the same number with opposite sign, so surfaces have no cracks.

Triangles are grouped by place. Groups outside of the picture are skipped, the others drawn from near to far, and
groups that lie behind everything drawn so far are skipped as well. Each band of rows is drawn by one thread, in a
fixed order: the number of threads can't change a picture.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, no-check-untyped-defs
from __future__ import annotations

from collections import deque

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole
from surveilnav.simulator.render.bands import in_bands, threads
from surveilnav.simulator.world.raycast import Hits

_GROUP = 64
_TILE = 16
_NEAR_M = 1e-3


class Rasteriser:
    """Draws triangles (T, 3, 3) float32 [m, world]; safe to share between threads."""

    def __init__(self, corners: NDArray[np.float32]) -> None:
        order = _by_place(corners)
        self._triangle = order.astype(np.uint32)
        self._corners = np.ascontiguousarray(corners[order])
        groups = -(-len(order) // _GROUP)
        starts = np.arange(groups) * _GROUP
        flat = self._corners
        self._low = np.minimum.reduceat(flat.min(axis=1), starts, axis=0) if groups else np.zeros((0, 3), np.float32)
        self._high = np.maximum.reduceat(flat.max(axis=1), starts, axis=0) if groups else np.zeros((0, 3), np.float32)
        self._workspaces: deque[NDArray[np.float32]] = deque()

    def cast(self, R: NDArray[np.float32], origin: NDArray[np.float32], camera: Pinhole) -> Hits:
        """First surface (H, W) along the rays of all pixels; R (3, 3) and origin (3,) place the camera in the world."""
        height, width = camera.height_px, camera.width_px
        lens = (float(camera.fx_px), float(camera.fy_px), float(camera.cx_px), float(camera.cy_px))
        groups = len(self._low)
        nearest = np.empty(groups, dtype=np.float32)
        window = np.empty((groups, 4), dtype=np.int32)
        R64, o64 = R.astype(np.float64), origin.astype(np.float64)
        in_bands(_look_at_groups, groups, self._low, self._high, R64, o64, *lens, height, width, nearest, window)
        seen = np.flatnonzero(nearest < np.inf)
        seen = seen[np.argsort(nearest[seen], kind="stable")]
        try:
            workspace = self._workspaces.pop()
        except IndexError:
            workspace = np.empty((len(self._corners), 3, 3), dtype=np.float32)
        # bands share the corners in the camera frame; on one thread only groups that aren't hidden need theirs
        alone = threads() == 1
        if not alone:
            in_bands(_to_camera, len(seen), seen, self._corners, R64, o64, workspace)
        t_hit = np.empty((height, width), dtype=np.float32)
        triangle = np.empty((height, width), dtype=np.uint32)
        bary = np.empty((height, width, 2), dtype=np.float32)
        in_bands(
            _draw,
            height,
            seen,
            len(self._corners),
            workspace,
            nearest,
            window,
            *lens,
            self._triangle,
            t_hit,
            triangle,
            bary,
            alone,
            self._corners,
            R64,
            o64,
        )
        self._workspaces.append(workspace)
        return Hits(t_hit, triangle, bary)


def _by_place(corners: NDArray[np.float32]) -> NDArray[np.int64]:
    """An order that puts triangles of like size and place together: large ones first, then along a Morton curve."""
    if not len(corners):
        return np.zeros(0, dtype=np.int64)
    low, high = corners.min(axis=1), corners.max(axis=1)
    centre = (low + high) / 2
    size = (high - low).max(axis=1)
    span = max(float((centre.max(axis=0) - centre.min(axis=0)).max()), 1e-6)
    grid = ((centre - centre.min(axis=0)) / span * 1023).astype(np.uint64)
    code = np.zeros(len(corners), dtype=np.uint64)
    for bit in range(10):
        for axis in range(3):
            code |= ((grid[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    size_class = np.digitize(-size, [-1.0, -0.25]).astype(np.uint64)
    return np.argsort((size_class << np.uint64(32)) | code, kind="stable")


@njit(nogil=True, cache=True)
def _look_at_groups(group0, group1, low, high, R, origin, fx, fy, cx, cy, height, width, nearest, window):
    """Nearest depth of each group's box (inf: not in the picture) and the pixels (x0, y0, x1, y1) that it may cover."""
    for g in range(group0, group1):
        z_min, z_max = np.inf, -np.inf
        x0, y0, x1, y1 = np.inf, np.inf, -np.inf, -np.inf
        # How many corners lie beyond each side of the view's pyramid.
        left, right, top, bottom = 0, 0, 0, 0
        for corner in range(8):
            px = (high[g, 0] if corner & 1 else low[g, 0]) - origin[0]
            py = (high[g, 1] if corner & 2 else low[g, 1]) - origin[1]
            pz = (high[g, 2] if corner & 4 else low[g, 2]) - origin[2]
            x = R[0, 0] * px + R[1, 0] * py + R[2, 0] * pz
            y = R[0, 1] * px + R[1, 1] * py + R[2, 1] * pz
            z = R[0, 2] * px + R[1, 2] * py + R[2, 2] * pz
            z_min, z_max = min(z_min, z), max(z_max, z)
            left += fx * x < (-1.0 - cx) * z
            right += fx * x > (width - cx) * z
            top += fy * y < (-1.0 - cy) * z
            bottom += fy * y > (height - cy) * z
            if z > _NEAR_M:
                u, v = fx * x / z + cx, fy * y / z + cy
                x0, x1, y0, y1 = min(x0, u), max(x1, u), min(y0, v), max(y1, v)
        nearest[g] = np.inf
        if z_max <= _NEAR_M or left == 8 or right == 8 or top == 8 or bottom == 8:
            continue
        if z_min <= _NEAR_M:  # reaches behind the camera: may cover anything
            nearest[g] = 0.0
            window[g, 0], window[g, 1], window[g, 2], window[g, 3] = 0, 0, width - 1, height - 1
            continue
        window[g, 0], window[g, 1] = int(max(x0 - 1.0, 0.0)), int(max(y0 - 1.0, 0.0))
        window[g, 2], window[g, 3] = int(min(x1 + 1.0, width - 1.0)), int(min(y1 + 1.0, height - 1.0))
        if window[g, 0] <= window[g, 2] and window[g, 1] <= window[g, 3]:
            nearest[g] = z_min * 0.99999


@njit(nogil=True, cache=True)
def _to_camera(k0, k1, seen, corners, R, origin, out):
    """Corners of the groups ``seen`` in the camera frame, into ``out`` at their own place."""
    for k in range(k0, k1):
        _group_to_camera(seen[k], corners, R, origin, out)


@njit(nogil=True, cache=True)
def _group_to_camera(g, corners, R, origin, out):
    for t in range(g * _GROUP, min(g * _GROUP + _GROUP, corners.shape[0])):
        for c in range(3):
            x, y, z = corners[t, c, 0] - origin[0], corners[t, c, 1] - origin[1], corners[t, c, 2] - origin[2]
            out[t, c, 0] = R[0, 0] * x + R[1, 0] * y + R[2, 0] * z
            out[t, c, 1] = R[0, 1] * x + R[1, 1] * y + R[2, 1] * z
            out[t, c, 2] = R[0, 2] * x + R[1, 2] * y + R[2, 2] * z


@njit(nogil=True, cache=True, inline="always")
def _cross(a0, a1, a2, b0, b1, b2):
    return a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0


@njit(nogil=True, cache=True)
def _draw(
    row0,
    row1,
    seen,
    count,
    corners,
    nearest,
    window,
    fx,
    fy,
    cx,
    cy,
    triangle_of,
    t_hit,
    triangle,
    bary,
    alone,
    world,
    R,
    origin,
):
    """Draws rows row0 to row1: inverse depth and winner per pixel, then depth and weights of the winners.

    ``corners``: (T, 3, 3) in the camera frame; ``alone``: to be made here, of those in the ``world``.
    """
    width = t_hit.shape[1]
    rows = row1 - row0
    inverse = np.zeros((rows, width), dtype=np.float32)
    winner = np.full((rows, width), -1, dtype=np.int32)
    tiles_x, tiles_y = (width + _TILE - 1) // _TILE, (rows + _TILE - 1) // _TILE
    # The farthest thing in each tile, as inverse depth: groups behind it can't be seen.
    farthest = np.zeros((tiles_y, tiles_x), dtype=np.float32)
    refresh_at = 32
    for k in range(seen.shape[0]):
        if k == refresh_at:
            refresh_at += max(32, k // 3)
            for ty in range(tiles_y):
                for tx in range(tiles_x):
                    lowest = np.float32(np.inf)
                    for r in range(ty * _TILE, min(ty * _TILE + _TILE, rows)):
                        for c in range(tx * _TILE, min(tx * _TILE + _TILE, width)):
                            lowest = min(lowest, inverse[r, c])
                    farthest[ty, tx] = lowest
        g = seen[k]
        if window[g, 3] < row0 or window[g, 1] >= row1:
            continue
        if nearest[g] > 0.0:
            closest = np.float32(1.0 / nearest[g])
            hidden = True
            for ty in range(max(window[g, 1] - row0, 0) // _TILE, min(window[g, 3] - row0, rows - 1) // _TILE + 1):
                for tx in range(window[g, 0] // _TILE, window[g, 2] // _TILE + 1):
                    if farthest[ty, tx] < closest:
                        hidden = False
                        break
                if not hidden:
                    break
            if hidden:
                continue
        if alone:
            _group_to_camera(g, world, R, origin, corners)
        for t in range(g * _GROUP, min(g * _GROUP + _GROUP, count)):
            ax, ay, az = np.float64(corners[t, 0, 0]), np.float64(corners[t, 0, 1]), np.float64(corners[t, 0, 2])
            bx, by, bz = np.float64(corners[t, 1, 0]), np.float64(corners[t, 1, 1]), np.float64(corners[t, 1, 2])
            gx, gy, gz = np.float64(corners[t, 2, 0]), np.float64(corners[t, 2, 1]), np.float64(corners[t, 2, 2])
            z_min = min(az, bz, gz)
            first, last = row0, row1 - 1
            left, right = 0, width - 1
            if z_min > _NEAR_M:
                va, vb, vc = ay / az, by / bz, gy / gz
                first = max(first, int(np.ceil(fy * min(va, vb, vc) + cy - 1e-6)))
                last = min(last, int(np.floor(fy * max(va, vb, vc) + cy + 1e-6)))
                if first > last:
                    continue
                ua, ub, uc = ax / az, bx / bz, gx / gz
                low_u, high_u = fx * min(ua, ub, uc) + cx, fx * max(ua, ub, uc) + cx
                if high_u < 0.0 or low_u > width - 1.0:
                    continue
                left, right = max(left, int(np.ceil(low_u - 1e-6))), min(right, int(np.floor(high_u + 1e-6)))
                if left > right:
                    continue
            elif max(az, bz, gz) <= _NEAR_M:
                continue
            e0x, e0y, e0z = _cross(bx, by, bz, gx, gy, gz)
            e1x, e1y, e1z = _cross(gx, gy, gz, ax, ay, az)
            e2x, e2y, e2z = _cross(ax, ay, az, bx, by, bz)
            det = ax * e0x + ay * e0y + az * e0z
            if abs(det) < 1e-15:
                continue
            sign = 1.0 if det > 0 else -1.0
            e0x, e0y, e0z, e1x, e1y, e1z = sign * e0x, sign * e0y, sign * e0z, sign * e1x, sign * e1y, sign * e1z
            e2x, e2y, e2z = sign * e2x, sign * e2y, sign * e2z
            # Inverse depth is linear in the pixel: (e0 + e1 + e2) / det.
            qx = (e0x + e1x + e2x) / (sign * det)
            qy = (e0y + e1y + e2y) / (sign * det)
            qz = (e0z + e1z + e2z) / (sign * det)
            for row in range(first, last + 1):
                y = (row - cy) / fy
                x_low, x_high = (left - cx) / fx, (right - cx) / fx
                # Where each edge's line crosses this row.
                empty = False
                for edge in range(3):
                    if edge == 0:
                        slope, at = e0x, e0y * y + e0z
                    elif edge == 1:
                        slope, at = e1x, e1y * y + e1z
                    else:
                        slope, at = e2x, e2y * y + e2z
                    if slope > 0.0:
                        x_low = max(x_low, -at / slope)
                    elif slope < 0.0:
                        x_high = min(x_high, -at / slope)
                    elif at < 0.0:
                        empty = True
                if empty or x_low > x_high:
                    continue
                c0, c1 = int(np.ceil(fx * x_low + cx - 1e-9)), int(np.floor(fx * x_high + cx + 1e-9))
                c0, c1 = max(c0, left), min(c1, right)
                q_row = qy * y + qz - qx * cx / fx
                step = qx / fx
                r = row - row0
                for c in range(c0, c1 + 1):
                    q = np.float32(q_row + step * c)
                    if q > inverse[r, c]:
                        inverse[r, c] = q
                        winner[r, c] = t
    for r in range(rows):
        row = row0 + r
        y = (row - cy) / fy
        for c in range(width):
            t = winner[r, c]
            if t < 0:
                t_hit[row, c] = np.inf
                triangle[row, c] = 0xFFFFFFFF
                bary[row, c, 0], bary[row, c, 1] = 0.0, 0.0
                continue
            x = (c - cx) / fx
            ax, ay, az = np.float64(corners[t, 0, 0]), np.float64(corners[t, 0, 1]), np.float64(corners[t, 0, 2])
            bx, by, bz = np.float64(corners[t, 1, 0]), np.float64(corners[t, 1, 1]), np.float64(corners[t, 1, 2])
            gx, gy, gz = np.float64(corners[t, 2, 0]), np.float64(corners[t, 2, 1]), np.float64(corners[t, 2, 2])
            e0x, e0y, e0z = _cross(bx, by, bz, gx, gy, gz)
            e1x, e1y, e1z = _cross(gx, gy, gz, ax, ay, az)
            e2x, e2y, e2z = _cross(ax, ay, az, bx, by, bz)
            w0, w1, w2 = e0x * x + e0y * y + e0z, e1x * x + e1y * y + e1z, e2x * x + e2y * y + e2z
            scale = 1.0 / (w0 + w1 + w2)
            t_hit[row, c] = (ax * e0x + ay * e0y + az * e0z) * scale
            triangle[row, c] = triangle_of[t]
            bary[row, c, 0] = min(max(w1 * scale, 0.0), 1.0)
            bary[row, c, 1] = min(max(w2 * scale, 0.0), 1.0)
