"""Free-space carving: voxels that a view sees through are removed from the point cloud.

A view sees through a voxel if everything that it shows around the voxel's centre lies farther away than the voxel, by more than
the noise of depth and a margin. That depends on one view and one voxel only. So it can be tested when the view arrives, for the
voxels that exist, or when a voxel arrives, for newer views that came before it. The result doesn't depend on the order of
views as long as those views are still kept (``FreeDepthHistory``).
"""

from __future__ import annotations

import bisect
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.geometry import inverse
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core.config import MapConfig
from surveilnav.services.fusion.core.maps.voxels import COARSE_CELLS

_COLS = 80  # cells across a picture


@dataclass(frozen=True, slots=True, eq=False)
class FreeDepthImage:
    """Up to which depth the space in front of a view is free, by cells of a few pixels.

    Attributes:
        order: (stamp_ns, source, view, seq) of the view; a newer view compares greater.
        camera: (20,) float64: T_camera_world (3, 4) row by row; fx, fy, cx, cy [px]; side of a cell [px]; the smallest and the
            largest depth [m] for which ``free_depth_m`` says anything; 0.
        free_depth_m: (rows, cols) float32: everything up to this depth is free in the cell and its neighbours; 0: unknown.
        coarse_max_m: the maximum of ``free_depth_m`` in and around coarse cells of 2x2 cells, for fast rejection.
    """

    order: tuple[int, str, int, int]
    camera: NDArray[np.float64]
    free_depth_m: NDArray[np.float32]
    coarse_max_m: NDArray[np.float32]

    @property
    def stamp_ns(self) -> int:
        """When the view was taken [ns]."""
        return self.order[0]

    @classmethod
    def from_view(cls, view: PosedView, config: MapConfig) -> FreeDepthImage:
        """Computes from a view's depth up to which depth the space in front of it is free.

        The picture is divided into about 80 cells across. The free depth of a cell is 0 (unknown) unless, in it and in each of
        its eight neighbours, more than half of the sampled pixels have a depth within the sensor's range and the range that
        ``config`` sets. So it is 0 in all cells at the picture's edge.
        """
        pinhole = view.camera
        near_m, far_m = view.depth_range_m
        far_m = min(far_m, config.max_range_robot_m if view.is_robot else config.max_range_camera_m)
        cell_px = max(1, pinhole.width_px // _COLS)
        # nearer than this, a voxel is wider than the cells around its centre, which then don't cover it
        near_m = max(near_m, 0.87 * config.voxel_m * pinhole.fx_px / cell_px)
        depth_m = np.ascontiguousarray(view.depth_m, dtype=np.float32)
        free_depth_m = _free_depths(
            depth_m, cell_px, view.depth_range_m[0], far_m, config.carve_margin_m, 3 * config.depth_noise_per_m
        )
        camera = np.zeros(20)
        camera[:12] = inverse(view.T_world_camera)[:3].ravel()
        camera[12:19] = (
            pinhole.fx_px,
            pinhole.fy_px,
            pinhole.cx_px,
            pinhole.cy_px,
            cell_px,
            near_m,
            free_depth_m.max(initial=0.0),
        )
        order = bounded_stamp_ns(view), view.source, view.view, view.seq
        return cls(order, camera, free_depth_m, _coarse_max(free_depth_m))

    def state(self) -> dict[str, Any]:
        """Everything as plain arrays and numbers, for ``from_state``."""
        return {"order": list(self.order), "camera": self.camera, "free_depth_m": self.free_depth_m}

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> FreeDepthImage:
        stamp_ns, source, view, seq = state["order"]
        free_depth_m = np.ascontiguousarray(state["free_depth_m"], np.float32)
        camera = np.ascontiguousarray(state["camera"], np.float64)
        order = int(stamp_ns), str(source), int(view), int(seq)
        return cls(order, camera, free_depth_m, _coarse_max(free_depth_m))


class FreeDepthHistory:
    """The free depths of the ``capacity`` newest views of a floor, to carve voxels that arrive late."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._images: list[FreeDepthImage] = []  # oldest first

    def __len__(self) -> int:
        return len(self._images)

    def add(self, image: FreeDepthImage) -> None:
        """Adds an image, and drops the oldest one if there are too many."""
        bisect.insort(self._images, image, key=lambda i: i.order)
        del self._images[: max(0, len(self._images) - self._capacity)]

    def newer_than(self, stamp_ns: int) -> list[FreeDepthImage]:
        """The images of views with a later stamp; those with the same stamp aren't newer."""
        return self._images[bisect.bisect_right(self._images, stamp_ns, key=lambda i: i.stamp_ns) :]

    def state(self) -> dict[str, Any]:
        """Everything as plain arrays and numbers, for ``from_state``."""
        return {"images": [image.state() for image in self._images]}

    @classmethod
    def from_state(cls, state: dict[str, Any], capacity: int) -> FreeDepthHistory:
        history = cls(capacity)
        for image in state["images"]:
            history.add(FreeDepthImage.from_state(image))
        return history


def bounded_stamp_ns(view: PosedView) -> int:
    """A view's stamp [ns], limited to 63 bits, since a remote may send anything."""
    return max(-(2**62), min(2**62, view.stamp_ns))


@njit(cache=True, nogil=True)
def _free_depths(depth_m, cell_px, near_m, far_m, margin_m, noise_per_m):  # type: ignore[no-untyped-def]
    """(rows, cols) float32: up to which depth each cell is free.

    It is the depth z with ``z + margin + noise z^2`` equal to the smallest depth in the 3x3 cells around; 0 where one of
    these cells says nothing.
    """
    rows, cols = depth_m.shape[0] // cell_px, depth_m.shape[1] // cell_px
    nearest = np.zeros((rows, cols), np.float32)
    step = max(1, cell_px // 4)
    for row in range(rows):
        for col in range(cols):
            least, n_measured, n_sampled = np.float32(np.inf), 0, 0
            for v in range(row * cell_px, (row + 1) * cell_px, step):
                for u in range(col * cell_px, (col + 1) * cell_px, step):
                    d = depth_m[v, u]
                    n_sampled += 1
                    if near_m <= d < far_m and d > 0.0:  # NaN fails
                        n_measured += 1
                        least = min(least, d)
            if 2 * n_measured > n_sampled:
                nearest[row, col] = least
    out = np.zeros((rows, cols), np.float32)
    for row in range(1, rows - 1):
        for col in range(1, cols - 1):
            least = nearest[row - 1 : row + 2, col - 1 : col + 2].min()
            if least > margin_m:
                room = np.float64(least) - margin_m
                out[row, col] = 2 * room / (1 + np.sqrt(1 + 4 * noise_per_m * room))
    return out


@njit(cache=True, nogil=True)
def _coarse_max(free_depth_m):  # type: ignore[no-untyped-def]
    """The maximum of the cells in each coarse cell and in its eight neighbours."""
    rows, cols = free_depth_m.shape
    out = np.zeros(((rows + COARSE_CELLS - 1) // COARSE_CELLS, (cols + COARSE_CELLS - 1) // COARSE_CELLS), np.float32)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            for row in range(max(0, (i - 1) * COARSE_CELLS), min(rows, (i + 2) * COARSE_CELLS)):
                for col in range(max(0, (j - 1) * COARSE_CELLS), min(cols, (j + 2) * COARSE_CELLS)):
                    out[i, j] = max(out[i, j], free_depth_m[row, col])
    return out
