"""Segments the object in a box by depth only.

The depth image is split into surfaces where depth jumps. The object is the surface that fills the centre of the box and ends
inside it; surfaces that continue beyond the box, such as the wall behind a table's legs, are background. The floor under an
object is connected to it, so if the picture shows a level floor (``find_floor``) its pixels are removed first.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole
from surveilnav.perception.protocols import RgbdView
from surveilnav.sensing.views import box_cells

#: On one surface, depth changes by at most this share from a pixel to the next.
_JUMP = 0.035
#: Larger boxes are subsampled to about this many pixels.
_MAX_PIXELS = 40_000
#: Margin around a box that is examined, too, as a share of the box's size.
_MARGIN = 0.2
_FLOOR_BAND_M = 0.06


class DepthInBox:
    """A ``Segmenter`` without a network."""

    model = "depth-in-box"

    def segment(
        self, views: Sequence[RgbdView], boxes: Sequence[NDArray[np.float32]]
    ) -> list[list[NDArray[np.bool_] | None]]:
        return [self._segment_view(view, xyxy) for view, xyxy in zip(views, boxes, strict=True)]

    @staticmethod
    def _segment_view(view: RgbdView, xyxy: NDArray[np.float32]) -> list[NDArray[np.bool_] | None]:
        floor = find_floor(view.depth_m, view.camera) if len(xyxy) else None
        return [find_mask(view.depth_m, (x0, y0, x1, y1), floor) for x0, y0, x1, y1 in xyxy.astype(float).tolist()]


def find_mask(
    depth_m: NDArray[np.float32], box_px: tuple[float, float, float, float], floor: NDArray[np.bool_] | None = None
) -> NDArray[np.bool_] | None:
    """Mask of a box's cells (``box_cells``), or None (the whole box) if depth doesn't show an object.

    Args:
        depth_m: (height, width) of the view, 0 where there is none.
        box_px: (x0, y0, x1, y1).
        floor: (height, width) mask of the pixels that show the floor.
    """
    height, width = depth_m.shape
    x0, y0, x1, y1 = box_cells(box_px, width, height)
    if x1 - x0 < 3 or y1 - y0 < 3:
        return None
    # The window around the box shows which surfaces continue beyond it. Box and window are on the same coarser grid.
    step = max(1, int(np.ceil(np.sqrt((x1 - x0) * (y1 - y0) / _MAX_PIXELS))))
    left, right = (min(room, round(_MARGIN * (x1 - x0))) // step for room in (x0, width - x1))
    above, below = (min(room, round(_MARGIN * (y1 - y0))) // step for room in (y0, height - y1))
    rows, cols = slice(y0 - above * step, y1 + below * step, step), slice(x0 - left * step, x1 + right * step, step)
    depth = np.ascontiguousarray(depth_m[rows, cols])
    smooth = cv2.medianBlur(depth, 5) if min(depth.shape) >= 5 else depth
    valid = smooth > 0
    box = slice(above, above + len(range(y0, y1, step))), slice(left, left + len(range(x0, x1, step)))
    if floor is not None:
        without = valid & ~floor[rows, cols]
        if without[box].sum() >= 0.1 * valid[box].size:  # otherwise the object itself lies flat on the floor
            valid = without
    if valid[box].sum() < max(6, 0.02 * valid[box].size):
        return None

    log_depth = np.log(np.where(valid, smooth, 1.0)).astype(np.float32)
    mask = _object_pixels(log_depth, _surfaces(log_depth, valid, step), box)
    if mask is None or mask.sum() < 0.03 * mask.size:
        return None
    if step > 1:
        mask = np.repeat(np.repeat(mask, step, axis=0), step, axis=1)[: y1 - y0, : x1 - x0]
        mask = mask & (depth_m[y0:y1, x0:x1] > 0)
    return mask


def _object_pixels(
    log_depth: NDArray[np.float32], surfaces: NDArray[np.int32], box: tuple[slice, slice]
) -> NDArray[np.bool_] | None:
    """The pixels of a box, within a window, that belong to the object; None if no surface fills the box's centre.

    Args:
        log_depth: of the window.
        surfaces: labels of the window's surfaces, 0: none.
        box: the box's rows and columns in the window.
    """
    inside = surfaces[box]
    n = int(surfaces.max()) + 1
    weight = np.bincount(inside.ravel(), weights=_centre_weight(inside.shape).ravel(), minlength=n)
    contained = np.bincount(inside.ravel(), minlength=n) / np.maximum(1, np.bincount(surfaces.ravel(), minlength=n))
    share = weight * contained**2
    share[0] = 0.0
    main = int(np.argmax(share))
    if share[main] <= 0:
        return None
    low, high = np.quantile(log_depth[box][inside == main], [0.02, 0.98])
    chosen = np.zeros(n, bool)
    # Further pieces of the object, such as legs and slats.
    for label in np.flatnonzero((weight > 0.01 * weight.sum()) & (contained > 0.6)):
        middle = float(np.median(log_depth[box][inside == label]))
        chosen[label] = label > 0 and low - 0.03 <= middle <= high + 0.03
    chosen[main] = True
    return np.asarray(chosen[inside])


def _centre_weight(shape: tuple[int, ...]) -> NDArray[np.float32]:
    v = np.linspace(-1, 1, shape[0], dtype=np.float32)[:, None]
    u = np.linspace(-1, 1, shape[1], dtype=np.float32)[None, :]
    return np.exp(-(u * u + v * v)).astype(np.float32)


def _surfaces(log_depth: NDArray[np.float32], valid: NDArray[np.bool_], step: int) -> NDArray[np.int32]:
    """Labels (0: none) of surfaces: connected pixels without a jump in log depth between them."""
    limit = np.float32(_JUMP * np.sqrt(step))
    jump = np.zeros(log_depth.shape, bool)  # pixels on the far side of a jump, so that the nearer surface keeps its rim
    across, down = np.diff(log_depth, axis=1), np.diff(log_depth, axis=0)
    jump[:, 1:] |= across > limit
    jump[:, :-1] |= across < -limit
    jump[1:, :] |= down > limit
    jump[:-1, :] |= down < -limit
    _, labels = cv2.connectedComponents((valid & ~jump).astype(np.uint8), connectivity=4)
    return np.asarray(labels, dtype=np.int32)


def find_floor(depth_m: NDArray[np.float32], camera: Pinhole) -> NDArray[np.bool_] | None:
    """Mask (height, width) of the pixels that show a level floor; None if there is none.

    In the frame of a sensor without roll, at pitch a and height h, the floor is the plane cos(a) y + sin(a) z = h. The
    pitch is found by a search in steps: at the right one, most of the lowest points lie in one thin layer, with almost none
    below it.
    """
    step = max(1, int(np.sqrt(depth_m.size / 5_000)))
    z = depth_m[step // 2 :: step, step // 2 :: step]
    rays = camera.rays()[step // 2 :: step, step // 2 :: step]
    seen = z > 0
    if seen.sum() < 300:
        return None
    z = z[seen].astype(np.float64)
    y = rays[..., 1][seen] * z
    best: tuple[float, float, float] | None = None  # (points in the layer, pitch, height)
    for pitch in np.radians(np.arange(-5.0, 70.1, 2.5)):  # steeper, a wall straight ahead looks the same
        down = np.cos(pitch) * y + np.sin(pitch) * z
        count, edges = np.histogram(down, bins=np.arange(0.3, 3.2, _FLOOR_BAND_M))
        layer = count[:-1] + count[1:]
        i = int(np.argmax(layer))
        below = int((down > edges[i + 2] + _FLOOR_BAND_M).sum())
        if below < 0.03 * layer[i] and (best is None or layer[i] > best[0]):
            inside = (down >= edges[i]) & (down < edges[i + 2])
            best = (float(layer[i]), float(pitch), float(np.median(down[inside])))
    if best is None or best[0] < 0.06 * len(z):
        return None
    _, pitch, height = best
    # Refine pitch and height on the layer itself: least squares of cos(a) y + sin(a) z = h.
    for band in (0.12, 0.06):
        down = np.cos(pitch) * y + np.sin(pitch) * z
        inside = np.abs(down - height) < band
        if inside.sum() < 100:
            return None
        slope, offset = np.polyfit(z[inside], y[inside], 1)
        pitch = float(np.arctan(-slope))
        height = float(offset * np.cos(pitch))
    down_map = np.float32(np.cos(pitch)) * camera.rays()[..., 1] + np.float32(np.sin(pitch))
    down_map = down_map * depth_m
    tolerance = np.float32(0.03) + np.float32(0.004) * depth_m * depth_m
    return (down_map > np.float32(height) - tolerance) & (depth_m > 0)
