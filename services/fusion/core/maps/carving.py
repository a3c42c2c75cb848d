"""Free-space carving: what a view sees through is not there (any more).

A view sees through a voxel if all that it shows around the voxel's centre lies behind it, by the noise of depth and a
margin. That is a relation of one view and one voxel, whatever else the map holds, so it may be asked when the view
comes or when the voxel does: order doesn't matter as long as the views that came early are still kept (``FreeDepthHistory``).
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
from surveilnav.services.fusion.core.maps.voxels import FAR_CELLS

_COLS = 80  # cells across a picture
_Camera = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FreeDepthImage:
    """How far a view is free, in cells of a few pixels.

    Attributes:
        order: (stamp_ns, source, view, seq): newer is larger.
        camera: (20,) float64: T_camera_world (3, 4) row by row, fx, fy, cx, cy [px], pixels across a cell, the
            nearest and the farthest depth [m] at which ``limit_m`` says something, 0.
        limit_m: (rows, cols) float32: up to this depth all is free around a cell; 0: no statement.
        far_m: the largest of ``limit_m`` around a coarse cell of a few: a quick no.
    """

    order: tuple[int, str, int, int]
    camera: _Camera
    limit_m: NDArray[np.float32]
    far_m: NDArray[np.float32]

    @property
    def stamp_ns(self) -> int:
        """When the view was taken [ns]."""
        return self.order[0]

    @classmethod
    def from_view(cls, view: PosedView, config: MapConfig) -> FreeDepthImage:
        """A view's clearance; a cell that is measured by less than half of its pixels says nothing."""
        pinhole = view.camera
        near_m, far_m = view.depth_range_m
        far_m = min(far_m, config.max_range_robot_m if view.is_robot else config.max_range_camera_m)
        cell_px = max(1, pinhole.width_px // _COLS)
        # nearer than this a voxel is wider than the cells around its centre, which then say too little
        near_m = max(near_m, 0.87 * config.voxel_m * pinhole.fx_px / cell_px)
        depth_m = np.ascontiguousarray(view.depth_m, dtype=np.float32)
        limit_m = _limits(
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
            limit_m.max(initial=0.0),
        )
        return cls((stamp_of(view), view.source, view.view, view.seq), camera, limit_m, _coarse(limit_m))

    def state(self) -> dict[str, Any]:
        """All of it, as plain arrays and numbers."""
        return {"order": list(self.order), "camera": self.camera, "limit_m": self.limit_m}

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> FreeDepthImage:
        """What ``state`` describes."""
        stamp_ns, source, view, seq = state["order"]
        limit_m = np.ascontiguousarray(state["limit_m"], np.float32)
        camera = np.ascontiguousarray(state["camera"], np.float64)
        return cls((int(stamp_ns), str(source), int(view), int(seq)), camera, limit_m, _coarse(limit_m))


class FreeDepthHistory:
    """The clearances of the newest views of a floor, at most ``capacity``: for voxels that come late."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._kept: list[FreeDepthImage] = []  # oldest first

    def __len__(self) -> int:
        return len(self._kept)

    def add(self, clearance: FreeDepthImage) -> None:
        """Keeps a clearance; the oldest one goes."""
        bisect.insort(self._kept, clearance, key=lambda c: c.order)
        del self._kept[: max(0, len(self._kept) - self._capacity)]

    def newer_than(self, stamp_ns: int) -> list[FreeDepthImage]:
        """Clearances of views with a later stamp (the same stamp is not newer)."""
        return self._kept[bisect.bisect_right(self._kept, stamp_ns, key=lambda c: c.stamp_ns) :]

    def state(self) -> dict[str, Any]:
        """All of it, as plain arrays and numbers, for ``from_state``."""
        return {"kept": [c.state() for c in self._kept]}

    @classmethod
    def from_state(cls, state: dict[str, Any], capacity: int) -> FreeDepthHistory:
        """The ring that ``state`` describes."""
        ring = cls(capacity)
        for clearance in state["kept"]:
            ring.add(FreeDepthImage.from_state(clearance))
        return ring


def stamp_of(view: PosedView) -> int:
    """A view's stamp [ns], cut to 63 bits: what a remote says may be anything."""
    return max(-(2**62), min(2**62, view.stamp_ns))


@njit(cache=True, nogil=True)
def _limits(depth_m, cell_px, near_m, far_m, margin_m, noise_per_m):  # type: ignore[no-untyped-def]
    """(rows, cols): the depth z with z + margin + noise z^2 = the nearest depth in the 3x3 cells around, or 0."""
    rows, cols = depth_m.shape[0] // cell_px, depth_m.shape[1] // cell_px
    nearest = np.zeros((rows, cols), np.float32)
    step = max(1, cell_px // 4)
    for row in range(rows):
        for col in range(cols):
            least, seen, asked = np.float32(np.inf), 0, 0
            for v in range(row * cell_px, (row + 1) * cell_px, step):
                for u in range(col * cell_px, (col + 1) * cell_px, step):
                    d = depth_m[v, u]
                    asked += 1
                    if near_m <= d < far_m and d > 0.0:  # NaN fails
                        seen += 1
                        least = min(least, d)
            if 2 * seen > asked:
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
def _coarse(limit_m):  # type: ignore[no-untyped-def]
    rows, cols = limit_m.shape
    out = np.zeros(((rows + FAR_CELLS - 1) // FAR_CELLS, (cols + FAR_CELLS - 1) // FAR_CELLS), np.float32)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            for row in range(max(0, (i - 1) * FAR_CELLS), min(rows, (i + 2) * FAR_CELLS)):
                for col in range(max(0, (j - 1) * FAR_CELLS), min(cols, (j + 2) * FAR_CELLS)):
                    out[i, j] = max(out[i, j], limit_m[row, col])
    return out
