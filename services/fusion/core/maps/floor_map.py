"""The geometry of one floor: point cloud, obstacle map and exploration map (the paper's section IV-C.2), by counting views."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.geometry import Grid
from surveilnav.occupancy import ESTIMATED_OBSTACLE, PRIOR_FREE, PRIOR_OBSTACLE
from surveilnav.sensing.views import LaserScan, PosedView
from surveilnav.services.fusion.core.config import MapConfig
from surveilnav.services.fusion.core.maps.carving import FreeDepthHistory, FreeDepthImage, bounded_stamp_ns
from surveilnav.services.fusion.core.maps.cloud import VoxelCloud
from surveilnav.services.fusion.core.maps.counting import CellCounts, count_voxels_in_cells
from surveilnav.services.fusion.core.maps.frontier import frontiers
from surveilnav.services.fusion.core.maps.projection import azimuth_bins, azimuth_ranges, camera_position, world_points
from surveilnav.services.fusion.core.maps.scan import count_beams, obstacles_of, scan_window

#: A rectangle of cells: (row0, col0, rows, cols). Rows and columns are counted from the world's origin.
Window = tuple[int, int, int, int]

_LAYERS = ("_visited", "_voxels_present", "_voxels_carved", "_scan_hits", "_scan_passes")  # beside the counts
_COUNTS = ("_measured", "_estimated")
#: Corrected depth is exactly the floor's where the floor is seen; this is for rounding.
_ON_FLOOR_M = 0.01


class FloorMap:
    """The geometry of one floor.

    Every layer is a function of counts per cell and of the carved voxels. So it doesn't depend on the order of views (provided
    that fewer than ``carve_memory`` newer views came before a late one). Cells are numbered from the world's origin, so
    it doesn't depend on where the map began either.

    Attributes:
        z_m: altitude of its surface [m, world].
        revision: revision of the joint map at which this floor last changed.
    """

    def __init__(self, floor: str, z_m: float, centre_m: tuple[float, float], config: MapConfig) -> None:
        self.floor = floor
        self.z_m = z_m
        self.revision = 0
        self._config = config
        r = config.resolution_m
        cells = max(1, round(config.extent_m / r))
        self._row0 = math.floor(centre_m[1] / r) - cells // 2
        self._col0 = math.floor(centre_m[0] / r) - cells // 2
        self._measured = CellCounts.zeros(cells, cells)
        self._estimated = CellCounts.zeros(cells, cells)
        self._visited = np.zeros((cells, cells), np.uint8)
        self._voxels_present = np.zeros((cells, cells), np.int32)  # voxels of the cloud at heights that block
        self._voxels_carved = np.zeros((cells, cells), np.int32)
        self._scan_hits = np.zeros((cells, cells), np.int32)
        self._scan_passes = np.zeros((cells, cells), np.int32)
        self._frontier: tuple[int, NDArray[np.uint8]] | None = None
        self._occupancy: NDArray[np.uint8] | None = None
        self._free_depths = FreeDepthHistory(config.carve_memory)
        self.cloud = VoxelCloud(config)
        self._prior: tuple[Grid, NDArray[np.uint8]] | None = None
        self._grow_to_prior()

    @property
    def grid(self) -> Grid:
        """The frame of all layers, as large as they are now."""
        r = self._config.resolution_m
        rows, cols = self._visited.shape
        return Grid(self._col0 * r, self._row0 * r, r, rows, cols)

    def integrate(self, view: PosedView) -> tuple[int, NDArray[np.float32]]:
        """Adds a view.

        Returns:
            The number of its points, and its ranges by azimuth (360, 2) [m] (``projection.azimuth_ranges``).

        Raises:
            ValueError: the camera is farther away than a map may grow.
        """
        c = self._config
        max_range_m = c.max_range_robot_m if view.is_robot else c.max_range_camera_m
        p_camera = camera_position(view.T_world_camera)
        self._occupancy = None
        # depth -> points in the world (the paper's p_global = R p + t)
        p_world, colours = world_points(view, c.points_per_view, max_range_m, c.depth_edge)
        window = window_around(p_world, p_camera, c.robot_radius_m, c.resolution_m)
        self._grow_to(*window)
        scan = self._blocking_scan(view)
        if scan is not None:
            self._grow_to(*scan_window(scan, c.max_range_robot_m, c.resolution_m))
        new, restored = self.cloud.add(p_world, colours, p_camera, view.source, bounded_stamp_ns(view))
        self._count_voxels(new, 1, 0)
        self._count_voxels(restored, 1, -1)
        # what the view sees through is carved away
        if c.carve_views:
            self._carve(view, new)
        # points and rays -> obstacle and exploration map
        ranges_m = azimuth_ranges(p_world, p_camera, self.z_m + c.explored_max_m, self.z_m - c.drop_min_m)
        max_explored_m = math.inf if view.is_robot else c.explored_range_camera_m
        near_m = np.minimum(ranges_m, np.float32(max_explored_m))
        explored = azimuth_bins(near_m, p_camera[0], p_camera[1], c.resolution_m, *window)
        self._count(self._measured, p_world, p_camera, explored, window, max_explored_m)
        if view.is_robot:
            self._mark_visited(p_camera)
        if scan is not None:
            self._count_scan(scan)
        return len(p_world), ranges_m

    def integrate_estimated(self, view: PosedView, sigma: float) -> tuple[int, NDArray[np.float32]]:
        """Adds a view whose depth is estimated: to the maps of obstacles and of explored floor, not to the point cloud.

        It counts only where no sensor has measured. Obstacles count as far as their place is certain enough.

        Args:
            view: its depth is corrected by the floor (``views.floor_fit``).
            sigma: standard deviation of the logarithm of depth.

        Returns:
            As ``integrate``.

        Raises:
            ValueError: the camera is farther away than a map may grow.
        """
        c = self._config
        p_camera = camera_position(view.T_world_camera)
        self._occupancy = None
        p_world, _ = world_points(view, c.points_per_view, c.max_range_camera_m, c.depth_edge)
        window = window_around(p_world, p_camera, c.robot_radius_m, c.resolution_m)
        self._grow_to(*window)
        ranges_m = azimuth_ranges(p_world, p_camera, self.z_m + c.explored_max_m, self.z_m - c.drop_min_m)
        ranges_m[:, 1] *= 1.0 - sigma
        # Where the floor is seen its depth is exact, by the pose. Only such floor is explored: the end of any other ray is too
        # uncertain to say what lies before it.
        on_floor = np.abs(p_world[:, 2] - self.z_m) < _ON_FLOOR_M
        is_certain = np.linalg.norm(p_world - p_camera, axis=1) <= c.estimated_max_sigma_m / max(sigma, 1e-3)
        for points, max_explored_m in (
            (p_world[on_floor], c.explored_range_camera_m),
            (p_world[~on_floor & is_certain], 0.0),
        ):
            by_no_ray = np.full(window[2:], -1, np.int16)
            self._count(self._estimated, points, p_camera, by_no_ray, window, max_explored_m)
        return len(p_world), ranges_m

    def occupied(self) -> NDArray[np.uint8]:
        """Obstacle map (rows, cols) uint8 of 0 and 1; measured, estimated and prior obstacles alike."""
        occupancy = self.occupancy()
        return np.asarray((occupancy != 0) & (occupancy != PRIOR_FREE)).view(np.uint8)

    def occupancy(self) -> NDArray[np.uint8]:
        """Occupancy (rows, cols) uint8: 0 free or unknown, ``OBSTACLE`` measured, ``ESTIMATED_OBSTACLE`` only estimated, and
        ``PRIOR_OBSTACLE`` or ``PRIOR_FREE`` where only a map from before knows something.

        Occupied are cells with enough points at heights that block, and drops: cells without a floor, through which enough
        rays go down. A cell is free again if it is plainly seen as bare floor, if all but a few of its voxels are carved away, or
        if a robot stood there. Estimates count where no sensor has measured. Laser scans have counts of their own: what passes
        at a scanner's height clears nothing that depth shows at another. A prior obstacle counts until bare floor is seen
        there or a robot stood there: rays may have passed above it. Prior free floor counts until anything is seen there.
        """
        if self._occupancy is None:
            self._occupancy = self._compute_occupancy()
        return self._occupancy

    def _compute_occupancy(self) -> NDArray[np.uint8]:
        c, counts = self._config, self._measured
        blocked = counts.obstacle_points >= c.obstacle_min_points
        bare = counts.floor_views > c.clear_ratio * counts.obstacle_views
        carved = (self._voxels_carved > 0) & (self._voxels_present < c.obstacle_min_points)
        drop = counts.drop_points >= c.obstacle_min_points
        has_floor = counts.floor_views > c.clear_ratio * counts.drop_views
        occupied = (blocked & ~bare & ~carved) | (drop & ~has_floor)
        occupied |= obstacles_of(self._scan_hits, self._scan_passes, c.scan_min_hits, c.scan_clear_ratio)
        out = np.asarray(occupied & (self._visited == 0)).view(np.uint8)
        estimated = self._estimated
        likely = estimated.obstacle_points >= c.obstacle_min_points
        if likely.any():
            likely &= estimated.floor_views <= c.estimated_clear_ratio * estimated.obstacle_views
            out[likely & ~counts.seen() & (self._visited == 0)] = ESTIMATED_OBSTACLE
        if (prior := self._prior_cells()) is not None:
            bare = (counts.floor_views > 0) | (estimated.floor_views > 0) | (self._visited > 0)
            out[(prior == PRIOR_OBSTACLE) & (out == 0) & ~bare] = PRIOR_OBSTACLE
            out[(prior == PRIOR_FREE) & (out == 0) & (self.explored() == 0)] = PRIOR_FREE
        return out

    def _prior_cells(self) -> NDArray[np.uint8] | None:
        """What is known of the floor from before, on its grid; None: nothing is."""
        prior = self._config.prior_of(self.floor)
        if prior is None:
            return None
        if self._prior is None or self._prior[0] != self.grid:
            self._prior = self.grid, prior.on_grid(self.grid)
        return self._prior[1]

    def _grow_to_prior(self) -> None:
        """Grows all layers until they contain what is known from before, unless that is too far away."""
        if prior := self._config.prior_of(self.floor):
            x0, y0, x1, y1 = (v / self._config.resolution_m for v in prior.extent())
            row0, col0 = math.floor(y0), math.floor(x0)
            with suppress(ValueError):
                self._grow_to(row0, col0, math.ceil(y1) - row0, math.ceil(x1) - col0)

    def explored(self) -> NDArray[np.uint8]:
        """Exploration map (rows, cols) uint8 of 0 and 1: cells where a point was seen, a ray passed, or a robot stood."""
        seen = (self._measured.explored_views > 0) | (self._estimated.explored_views > 0)
        return (seen | (self._visited > 0)).view(np.uint8)

    def frontier(self) -> NDArray[np.uint8]:
        """Frontier map (rows, cols) uint8 of 0 and 1."""
        if self._frontier is None or self._frontier[0] != self.revision:
            self._frontier = self.revision, frontiers(self.occupied(), self.explored(), self._config)
        return self._frontier[1]

    def state(self) -> dict[str, Any]:
        """Everything as plain arrays and numbers, for ``from_state``; nothing in it changes when the map does."""
        return {
            "floor": self.floor,
            "z_m": self.z_m,
            "revision": self.revision,
            "row0": self._row0,
            "col0": self._col0,
            "layers": {name.lstrip("_"): getattr(self, name).copy() for name in _LAYERS},
            "counts": {
                name.lstrip("_"): {key: layer.copy() for key, layer in getattr(self, name).layers()} for name in _COUNTS
            },
            "cloud": self.cloud.state(),
            "free_depths": self._free_depths.state(),
        }

    @classmethod
    def from_state(cls, state: dict[str, Any], config: MapConfig) -> FloorMap:
        floor = cls(state["floor"], float(state["z_m"]), (0.0, 0.0), config)
        floor.revision, floor._row0, floor._col0 = int(state["revision"]), int(state["row0"]), int(state["col0"])
        for name in _LAYERS:  # stores of before there were scans have none
            layer = state["layers"].get(name.lstrip("_"))
            none = np.zeros(state["layers"]["visited"].shape, np.int32)
            setattr(floor, name, none if layer is None else np.array(layer))
        for name in _COUNTS:
            counts = {key: np.array(layer) for key, layer in state["counts"][name.lstrip("_")].items()}
            setattr(floor, name, CellCounts(**counts))
        floor.cloud = VoxelCloud.from_state(state["cloud"], config)
        floor._free_depths = FreeDepthHistory.from_state(state["free_depths"], config.carve_memory)
        floor._grow_to_prior()  # the building file may have got it since
        return floor

    def _carve(self, view: PosedView, new: NDArray[np.int32]) -> None:
        """Carves the cloud by a view, and the voxels that are new with it by newer views that came before."""
        image = FreeDepthImage.from_view(view, self._config)
        carved = self.cloud.carve(image)
        carved_at_once = self.cloud.carve_listed(new, self._free_depths.newer_than(image.stamp_ns))
        self._free_depths.add(image)
        self._count_voxels(carved, -1, 1)
        self._count_voxels(carved_at_once, -1, 1)

    def _count_voxels(self, voxels: NDArray[np.int32], present: int, carved: int) -> None:
        """Adds ``present`` and ``carved`` to the counts of the cells of voxels, if these are at heights that block."""
        if not len(voxels):
            return
        c = self._config
        count_voxels_in_cells(
            self.cloud.centres(voxels),
            self._row0,
            self._col0,
            c.resolution_m,
            self.z_m + c.obstacle_min_m,
            self.z_m + c.obstacle_max_m,
            present,
            carved,
            self._voxels_present,
            self._voxels_carved,
        )

    def _count(
        self,
        counts: CellCounts,
        p_world: NDArray[np.float32],
        p_camera: NDArray[np.float64],
        explored: NDArray[np.int16],
        window: Window,
        max_explored_m: float,
    ) -> None:
        """Counts what a view shows in each cell of a window; arguments as in ``CellCounts.add``."""
        corner = window[0], window[1]
        offset = window[0] - self._row0, window[1] - self._col0
        counts.add(p_world, p_camera, self.z_m, explored, corner, offset, max_explored_m, self._config)

    def _blocking_scan(self, view: PosedView) -> LaserScan | None:
        """The view's laser scan, if the scanner is at a height that blocks."""
        low_m, high_m = self._config.obstacle_min_m, self._config.obstacle_max_m
        scan = view.scan if view.is_robot else None
        return scan if scan is not None and low_m <= scan.origin_m[2] - self.z_m <= high_m else None

    def _count_scan(self, scan: LaserScan) -> None:
        """Counts where the beams of a scan ended and passed."""
        reach_m, r = self._config.max_range_robot_m, self._config.resolution_m
        row0, col0, rows, cols = scan_window(scan, reach_m, r)
        part = np.s_[row0 - self._row0 : row0 - self._row0 + rows, col0 - self._col0 : col0 - self._col0 + cols]
        beams = scan.ranges_m, scan.ends, *scan.origin_m[:2], scan.start_rad, scan.step_rad
        count_beams(*beams, reach_m, r, row0, col0, self._scan_hits[part], self._scan_passes[part])

    def _mark_visited(self, p_camera: NDArray[np.float64]) -> None:
        """Marks the cells under a robot as visited; its camera is above its centre."""
        r, radius_m = self._config.resolution_m, self._config.robot_radius_m
        n = math.floor(radius_m / r)
        row, col = math.floor(p_camera[1] / r), math.floor(p_camera[0] / r)
        rows, cols = np.mgrid[row - n : row + n + 1, col - n : col + n + 1]
        under = np.hypot((cols + 0.5) * r - p_camera[0], (rows + 0.5) * r - p_camera[1]) <= radius_m
        under[n, n] = True
        self._visited[rows[under] - self._row0, cols[under] - self._col0] = 1

    def _grow_to(self, row0: int, col0: int, rows: int, cols: int) -> None:
        """Grows all layers until they contain a window, by 2 m more than needed, so that it happens seldom."""
        r, old_shape = self._config.resolution_m, self._visited.shape
        margin = math.ceil(2.0 / r)
        below, left = max(0, self._row0 - row0), max(0, self._col0 - col0)
        above = max(0, row0 + rows - self._row0 - old_shape[0])
        right = max(0, col0 + cols - self._col0 - old_shape[1])
        if not (below or left or above or right):
            return
        below, left, above, right = (n and n + margin for n in (below, left, above, right))
        shape = old_shape[0] + below + above, old_shape[1] + left + right
        if max(shape) * r > self._config.max_extent_m:
            raise ValueError(
                f"a view would make the map of floor {self.floor} {shape[1] * r:.0f} x {shape[0] * r:.0f} m; "
                f"at most {self._config.max_extent_m:g} m are allowed (max_extent_m)"
            )
        self._row0, self._col0 = self._row0 - below, self._col0 - left
        layers: list[tuple[FloorMap | CellCounts, str]] = [(self, name) for name in _LAYERS]
        layers += [(counts, name) for counts in (self._measured, self._estimated) for name, _ in counts.layers()]
        for owner, name in layers:
            old = getattr(owner, name)
            new = np.zeros(shape, old.dtype)
            new[below : below + old.shape[0], left : left + old.shape[1]] = old
            setattr(owner, name, new)


def window_around(
    p_world: NDArray[np.float32], p_camera: NDArray[np.float64], radius_m: float, resolution_m: float
) -> Window:
    """The window of cells that contains points (N, 3) [m, world] and a circle of ``radius_m`` around a camera (3,)."""
    low, high = p_camera[:2] - radius_m - resolution_m, p_camera[:2] + radius_m + resolution_m
    if len(p_world):
        box = _bounds(p_world)
        low, high = np.minimum(low, box[0]), np.maximum(high, box[1])
    col0, row0 = (math.floor(float(v) / resolution_m) for v in low)
    col1, row1 = (math.floor(float(v) / resolution_m) for v in high)
    return row0, col0, row1 - row0 + 1, col1 - col0 + 1


@njit(cache=True, nogil=True)
def _bounds(points):  # type: ignore[no-untyped-def]
    box = np.empty((2, 2), np.float64)
    for k in range(2):
        box[0, k] = box[1, k] = points[0, k]
    for i in range(points.shape[0]):
        for k in range(2):
            box[0, k] = min(box[0, k], points[i, k])
            box[1, k] = max(box[1, k], points[i, k])
    return box
