"""The utility of camera views, on hand-made floors. '#': obstacle, '.': explored, ' ': unknown, 'f': frontier."""

from __future__ import annotations

import math

import numpy as np
import pytest

from surveilnav.geometry import Grid, Pinhole
from surveilnav.services.fusion.core import FusionConfig, JointMap
from surveilnav.services.fusion.core.config import ViewOrderConfig
from surveilnav.services.fusion.core.views.order import KnownFloor, ViewFootprint, floor_utilities_m2

CONFIG = ViewOrderConfig()
LENS = Pinhole.from_hfov(640, 640, math.radians(100.0))
NO_ROBOT = np.zeros((0, 2))


def pose(yaw_deg: float, tilt_deg: float, z_m: float = 1.8) -> np.ndarray:
    """A camera at (0, 0, z) that looks down by ``tilt_deg``."""
    yaw, tilt = math.radians(yaw_deg), math.radians(tilt_deg)
    T = np.eye(4)
    T[:3, 2] = math.cos(yaw) * math.cos(tilt), math.sin(yaw) * math.cos(tilt), -math.sin(tilt)
    T[:3, 0] = math.sin(yaw), -math.cos(yaw), 0.0
    T[:3, 1] = np.cross(T[:3, 2], T[:3, 0])
    T[2, 3] = z_m
    return T


def footprint(yaw_deg: float = 0.0, tilt_deg: float = 30.0, range_m: float = 3.0) -> ViewFootprint:
    return ViewFootprint.from_view(pose(yaw_deg, tilt_deg), LENS, 0.0, range_m)


def floor(text: str, west_m: float = -4.0, south_m: float = -4.0) -> KnownFloor:
    """Drawn north up, cells of 1 m."""
    rows = [list(line.ljust(9)) for line in text.strip("\n").split("\n")][::-1]
    cells = np.array(rows + [[" "] * 9] * (9 - len(rows)))
    layers = ((cells == c).astype(np.uint8) for c in "#")
    grid = Grid(west_m, south_m, 1.0, *cells.shape)
    return KnownFloor(grid, *layers, (cells != " ").astype(np.uint8), (cells == "f").astype(np.uint8))


def utility(view: ViewFootprint, known: KnownFloor | None, robots: np.ndarray = NO_ROBOT) -> float:
    return float(floor_utilities_m2([view], known, robots, CONFIG)[0])


def slow(view: ViewFootprint, known: KnownFloor | None, robots: np.ndarray) -> float:
    """The definition, point by point of a fine square lattice; nothing stands in the way."""
    total, side = 0.0, 0.04
    for x in np.arange(-3.0, 3.0, side) + side / 2:
        for y in np.arange(-3.0, 3.0, side) + side / 2:
            r, off = math.hypot(x, y), math.remainder(math.atan2(y, x) - view.azimuth_rad, 2 * math.pi)
            if not (view.from_m <= r <= view.to_m and abs(off) <= view.half_width_rad):
                continue
            w = 1.0
            if known is not None and known.grid.contains(cell := known.grid.cells_of((x, y))):
                row, col = cell
                w = CONFIG.explored_weight if known.explored[row, col] else 1.0
                w = CONFIG.frontier_weight if known.frontier[row, col] else w
            d = min((math.hypot(x - a, y - b) for a, b in robots), default=0.0)
            total += w * math.exp(-d / CONFIG.distance_scale_m) * side * side
    return total


HALF_KNOWN = "....     \n....f    \n....f    \n....f    \n....f    \n....f    \n....f    \n....     \n....     "


@pytest.mark.parametrize("known", [None, floor(HALF_KNOWN)], ids=["nothing known", "half known"])
@pytest.mark.parametrize("robots", [NO_ROBOT, np.array([(1.0, 2.0), (-6.0, 0.0)])], ids=["no robot", "two robots"])
@pytest.mark.parametrize(("yaw_deg", "tilt_deg"), [(10.0, 0.0), (0.0, 30.0), (140.0, 50.0), (20.0, 90.0)])
def test_utility_is_the_integral_that_it_says(yaw_deg, tilt_deg, robots, known):
    view = footprint(yaw_deg, tilt_deg)
    assert utility(view, known, robots) == pytest.approx(
        slow(view, known, robots), rel=0.05
    )  # rays are sampled every 10 cm


def test_a_footprint_is_what_the_picture_shows_of_the_floor():
    level, steep, down = footprint(90.0, 0.0), footprint(0.0, 60.0), footprint(0.0, 90.0)
    half_height = math.atan(LENS.height_px / (2 * LENS.fy_px))
    assert level.azimuth_rad == pytest.approx(math.pi / 2)
    assert (level.from_m, level.to_m) == pytest.approx((1.8 / math.tan(half_height), 3.0))
    assert steep.from_m == 0.0  # below its foot
    assert steep.to_m == pytest.approx(min(3.0, 1.8 / math.tan(math.radians(60.0) - half_height)))
    assert down.half_width_rad == pytest.approx(math.pi)
    assert down.to_m == pytest.approx(1.8 / math.tan(math.pi / 2 - half_height))


def test_a_wall_hides_what_is_behind_it():
    open_, walled = " " * 9, "     #   "
    hidden = utility(footprint(), floor("\n".join([walled] * 9)))
    assert hidden < 0.3 * utility(footprint(), floor("\n".join([open_] * 9)))


def test_frontiers_and_places_near_the_robot_come_first():
    frontier = floor("\n".join(["....ff   "] * 9))
    east, west = floor_utilities_m2([footprint(0.0), footprint(180.0)], frontier, NO_ROBOT, CONFIG)
    assert east > 10 * west > 0.0
    near, far = floor_utilities_m2([footprint(0.0), footprint(180.0)], None, np.array([(2.0, 0.0)]), CONFIG)
    assert near > far


def test_maps_weigh_views_floor_by_floor():
    """Views of a floor without a robot have no utility now; a floor of which nothing is known is unexplored."""
    joint = JointMap(FusionConfig())
    upstairs = ViewFootprint.from_view(pose(0.0, 30.0, z_m=4.8), LENS, 3.0, 3.0)
    here, above = joint.view_utilities([footprint(), upstairs], [(0.0, 0.0, 0.1)])
    assert here == pytest.approx(utility(footprint(), None, np.zeros((1, 2))))
    assert above == 0.0
    assert joint.view_utilities([], [(0.0, 0.0, 0.0)]).shape == (0,)
