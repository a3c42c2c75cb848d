"""One floor: point cloud, obstacle map and exploration map (the paper's section IV-C.2), from counts of what views saw."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.geometry import Grid
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core.config import MapConfig
from surveilnav.services.fusion.core.maps.carving import FreeDepthImage, FreeDepthHistory, stamp_of
from surveilnav.services.fusion.core.maps.cloud import VoxelCloud
from surveilnav.services.fusion.core.maps.frontier import frontiers
from surveilnav.services.fusion.core.maps.projection import azimuth_bins, camera_position, reach, world_points

#: Rows and columns counted from the world's origin: (row0, col0, rows, cols).
Window = tuple[int, int, int, int]

_MOST = 2**32 - 1  # counts stop here
_LAYERS = (
    "_obstacle_points",
    "_obstacle_views",
    "_bare_views",
    "_explored_views",
    "_visited",
    "_voxels_there",
    "_voxels_gone",
    "_drop_points",
    "_drop_views",
)
_BARE_FLOOR_M = 0.08  # nearer than this to the floor's altitude a point is floor


class FloorMap:
    """The geometry of one floor.

    Every layer is a function of counts and of what is gone of the cloud: the order of views doesn't matter (a late view
    must have fewer than ``carve_memory`` newer ones before it), and cells are numbered from the world's origin, so
    neither does where the map began.

    Attributes:
        floor: its id.
        z_m: altitude of the floor's surface.
        cloud: the joint point cloud.
        revision: that of the joint map when this floor last changed.
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
        self._obstacle_points = np.zeros((cells, cells), np.uint32)
        self._obstacle_views = np.zeros((cells, cells), np.uint32)
        self._bare_views = np.zeros((cells, cells), np.uint32)
        self._explored_views = np.zeros((cells, cells), np.uint32)
        self._visited = np.zeros((cells, cells), np.uint8)
        self._voxels_there = np.zeros((cells, cells), np.int32)  # of the cloud, in the band that blocks
        self._voxels_gone = np.zeros((cells, cells), np.int32)
        self._drop_points = np.zeros((cells, cells), np.uint32)
        self._drop_views = np.zeros((cells, cells), np.uint32)
        self._frontier: tuple[int, NDArray[np.uint8]] | None = None
        self._occupied: NDArray[np.uint8] | None = None
        self._free_space = FreeDepthHistory(config.carve_memory)
        self.cloud = VoxelCloud(config)

    @property
    def grid(self) -> Grid:
        """Frame of all layers as they are now."""
        r = self._config.resolution_m
        rows, cols = self._obstacle_points.shape
        return Grid(self._col0 * r, self._row0 * r, r, rows, cols)

    def integrate(self, view: PosedView) -> tuple[int, NDArray[np.float32]]:
        """Adds a view; returns the number of its points and its reach (360, 2) [m] by azimuth.

        Raises:
            ValueError: pictures of the wrong size, or a camera farther off than a map may grow.
        """
        c = self._config
        max_range_m = c.max_range_robot_m if view.is_robot else c.max_range_camera_m
        p_camera = camera_position(view.T_world_camera)
        self._occupied = None
        # depth -> points in the world (the paper's p_global = R p + t)
        p_world, colours = world_points(view, c.points_per_view, max_range_m, c.depth_edge)
        window = window_around(p_world, p_camera, c.robot_radius_m, c.resolution_m)
        self._cover(*window)
        new, back = self.cloud.add(p_world, colours, p_camera, view.source, stamp_of(view))
        self._tally(new, 1, 0)
        self._tally(back, 1, -1)
        # what is seen to be gone
        if c.carve_views:
            self._carve(view, new)
        # points and rays -> obstacle and exploration map
        reach_m = reach(p_world, p_camera, self.z_m + c.explored_max_m, self.z_m - c.drop_min_m)
        self._count(p_world, p_camera, reach_m, window, math.inf if view.is_robot else c.explored_range_camera_m)
        if view.is_robot:
            self._stand(p_camera)
        return len(p_world), reach_m

    def occupied(self) -> NDArray[np.uint8]:
        """Obstacle map (rows, cols) uint8: cells with enough points in the band, and drops: cells without a floor, through
        which enough rays went down.

        Free again are those seen as plainly bare floor, those whose voxels are gone but a few, and where a robot stood.
        """
        if self._occupied is None:
            self._occupied = self._blocked()
        return self._occupied

    def _blocked(self) -> NDArray[np.uint8]:
        c = self._config
        blocked = self._obstacle_points >= c.obstacle_min_points
        bare = self._bare_views > c.clear_ratio * self._obstacle_views
        gone = (self._voxels_gone > 0) & (self._voxels_there < c.obstacle_min_points)
        drop = self._drop_points >= c.obstacle_min_points
        floor = self._bare_views > c.clear_ratio * self._drop_views
        occupied = (blocked & ~bare & ~gone) | (drop & ~floor)
        return np.asarray(occupied & (self._visited == 0)).view(np.uint8)

    def explored(self) -> NDArray[np.uint8]:
        """Exploration map (rows, cols) uint8: a point was seen there, or a ray passed, or a robot stood there."""
        return ((self._explored_views > 0) | (self._visited > 0)).view(np.uint8)

    def frontier(self) -> NDArray[np.uint8]:
        """Frontier map (rows, cols) uint8."""
        if self._frontier is None or self._frontier[0] != self.revision:
            self._frontier = self.revision, frontiers(self.occupied(), self.explored(), self._config)
        return self._frontier[1]

    def state(self) -> dict[str, Any]:
        """All of it, as plain arrays and numbers, for ``from_state``."""
        return {
            "floor": self.floor,
            "z_m": self.z_m,
            "revision": self.revision,
            "row0": self._row0,
            "col0": self._col0,
            "layers": {name.lstrip("_"): getattr(self, name) for name in _LAYERS},
            "cloud": self.cloud.state(),
            "free_space": self._free_space.state(),
        }

    @classmethod
    def from_state(cls, state: dict[str, Any], config: MapConfig) -> FloorMap:
        """The map that ``state`` was taken of, under the same ``config``."""
        floor = cls(state["floor"], float(state["z_m"]), (0.0, 0.0), config)
        floor.revision, floor._row0, floor._col0 = int(state["revision"]), int(state["row0"]), int(state["col0"])
        layers = {name: np.zeros_like(state["layers"]["obstacle_points"]) for name in ("drop_points", "drop_views")}
        layers |= state["layers"]  # maps kept before drops were mapped have none
        for name in _LAYERS:
            setattr(floor, name, np.array(layers[name.lstrip("_")]))
        floor.cloud = VoxelCloud.from_state(state["cloud"], config)
        floor._free_space = FreeDepthHistory.from_state(state["free_space"], config.carve_memory)
        return floor

    def _carve(self, view: PosedView, new: NDArray[np.int32]) -> None:
        clearance = FreeDepthImage.from_view(view, self._config)
        gone = self.cloud.carve(clearance)
        late = self.cloud.recheck(new, self._free_space.newer_than(clearance.stamp_ns))
        self._free_space.add(clearance)
        self._tally(gone, -1, 1)
        self._tally(late, -1, 1)

    def _tally(self, voxels: NDArray[np.int32], there: int, gone: int) -> None:
        """Counts voxels of the cloud in the cells of their centres, if they stand where things block."""
        if not len(voxels):
            return
        c = self._config
        _tally_voxels(
            self.cloud.centres(voxels),
            self._row0,
            self._col0,
            c.resolution_m,
            self.z_m + c.obstacle_min_m,
            self.z_m + c.obstacle_max_m,
            there,
            gone,
            self._voxels_there,
            self._voxels_gone,
        )

    def _count(
        self,
        p_world: NDArray[np.float32],
        p_camera: NDArray[np.float64],
        reach_m: NDArray[np.float32],
        window: Window,
        farthest_m: float,
    ) -> None:
        c = self._config
        row0, col0, rows, cols = window
        seen = azimuth_bins(
            np.minimum(reach_m, np.float32(farthest_m)),
            p_camera[0],
            p_camera[1],
            c.resolution_m,
            row0,
            col0,
            rows,
            cols,
        )
        part = np.s_[row0 - self._row0 : row0 - self._row0 + rows, col0 - self._col0 : col0 - self._col0 + cols]
        _count_points(
            p_world,
            p_camera,
            self.z_m,
            c.resolution_m,
            row0,
            col0,
            seen,
            farthest_m**2,
            c.obstacle_min_m,
            c.obstacle_max_m,
            c.drop_min_m,
            c.obstacle_noise_per_m,
            c.explored_max_m,
            self._obstacle_points[part],
            self._obstacle_views[part],
            self._drop_points[part],
            self._drop_views[part],
            self._bare_views[part],
            self._explored_views[part],
        )

    def _stand(self, p_camera: NDArray[np.float64]) -> None:
        r, radius_m = self._config.resolution_m, self._config.robot_radius_m
        n = math.floor(radius_m / r)
        row, col = math.floor(p_camera[1] / r), math.floor(p_camera[0] / r)
        rows, cols = np.mgrid[row - n : row + n + 1, col - n : col + n + 1]
        under = np.hypot((cols + 0.5) * r - p_camera[0], (rows + 0.5) * r - p_camera[1]) <= radius_m
        under[n, n] = True
        self._visited[rows[under] - self._row0, cols[under] - self._col0] = 1

    def _cover(self, row0: int, col0: int, rows: int, cols: int) -> None:
        """Grows all layers until they hold the window, by 2 m more than needed so that it happens seldom."""
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
        for name in _LAYERS:
            old = getattr(self, name)
            new = np.zeros(shape, old.dtype)
            new[below : below + old.shape[0], left : left + old.shape[1]] = old
            setattr(self, name, new)


def window_around(
    p_world: NDArray[np.float32], p_camera: NDArray[np.float64], radius_m: float, resolution_m: float
) -> Window:
    """World cells (row0, col0, rows, cols) that hold the points (N, 3) and the camera with ``radius_m`` around it."""
    low, high = p_camera[:2] - radius_m - resolution_m, p_camera[:2] + radius_m + resolution_m
    if len(p_world):
        box = _bounds(p_world)
        low, high = np.minimum(low, box[0]), np.maximum(high, box[1])
    col0, row0 = (math.floor(float(v) / resolution_m) for v in low)
    col1, row1 = (math.floor(float(v) / resolution_m) for v in high)
    return row0, col0, row1 - row0 + 1, col1 - col0 + 1


@njit(cache=True, nogil=True)
def _tally_voxels(  # type: ignore[no-untyped-def]
    centres, row0, col0, resolution_m, low, high, there, gone, n_there, n_gone
):
    for i in range(len(centres)):
        if low <= centres[i, 2] <= high:
            row = int(np.floor(centres[i, 1] / resolution_m)) - row0
            col = int(np.floor(centres[i, 0] / resolution_m)) - col0
            if 0 <= row < n_there.shape[0] and 0 <= col < n_there.shape[1]:
                n_there[row, col] += there
                n_gone[row, col] += gone


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


@njit(cache=True, nogil=True)
def _count_points(  # type: ignore[no-untyped-def]
    points,
    p_camera,
    z,
    resolution_m,
    row0,
    col0,
    seen,
    farthest_squared,
    low,
    high,
    drop,
    noise,
    explored_max,
    obstacle_points,
    obstacle_views,
    drop_points,
    drop_views,
    bare_views,
    explored_views,
):
    rows, cols = seen.shape
    blocks = np.zeros((rows, cols), np.uint16)
    falls = np.zeros((rows, cols), np.uint16)
    bare = np.zeros((rows, cols), np.uint8)
    for i in range(points.shape[0]):
        x, y = np.float64(points[i, 0]), np.float64(points[i, 1])
        height = points[i, 2] - z
        dx, dy = points[i, 0] - p_camera[0], points[i, 1] - p_camera[1]
        squared = dx * dx + dy * dy
        falling = height < -drop - noise * squared
        if falling:  # where the ray is that deep in the air there is no floor; over the point itself there may be one
            share = (p_camera[2] - z + drop) / (p_camera[2] - points[i, 2])
            if not 0.0 < share <= 1.0:
                continue
            x, y, squared = p_camera[0] + share * dx, p_camera[1] + share * dy, share * share * squared
        col = int(np.floor(x / resolution_m)) - col0
        row = int(np.floor(y / resolution_m)) - row0
        if height <= explored_max and squared <= farthest_squared:  # where a point is, the cell was seen, whatever the
            seen[row, col] = 0  # ray's azimuth
        if falling:
            falls[row, col] += 1
        elif low + noise * squared <= height <= high:
            blocks[row, col] += 1
        elif abs(height) <= _BARE_FLOOR_M:
            bare[row, col] = 1
    for row in range(rows):
        for col in range(cols):
            n, fallen = blocks[row, col], falls[row, col]
            if n > 0:
                obstacle_points[row, col] = min(_MOST, int(obstacle_points[row, col]) + n)
                obstacle_views[row, col] = min(_MOST, int(obstacle_views[row, col]) + 1)
            if fallen > 0:
                drop_points[row, col] = min(_MOST, int(drop_points[row, col]) + fallen)
                drop_views[row, col] = min(_MOST, int(drop_views[row, col]) + 1)
            if n == 0 and fallen == 0 and bare[row, col] > 0:
                bare_views[row, col] = min(_MOST, int(bare_views[row, col]) + 1)
            if seen[row, col] >= 0:
                explored_views[row, col] = min(_MOST, int(explored_views[row, col]) + 1)
