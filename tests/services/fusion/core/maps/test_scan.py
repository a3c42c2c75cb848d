"""Laser scans in the obstacle map: what they block and free, and that they leave alone what depth shows."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.geometry import Pinhole
from surveilnav.sensing.views import LaserScan, PosedView
from surveilnav.services.fusion.core.config import MapConfig
from surveilnav.services.fusion.core.maps.floor_map import FloorMap

CONFIG = MapConfig(extent_m=4.0)
N, START_RAD = 360, 0.003


def room_scan(x=0.0, y=0.0, z=0.2, half_m=2.0, box=None):
    """A scan in a square room around the origin; ``box``: (x, y, half side) of something in it."""
    angles = START_RAD + np.arange(N) * (2 * math.pi / N)
    c, s = np.cos(angles), np.sin(angles)
    ranges = np.minimum((half_m * np.sign(c) - x) / c, (half_m * np.sign(s) - y) / s)
    if box is not None:
        for i in range(N):
            for d in np.arange(0.05, ranges[i], 0.01):
                if max(abs(x + d * c[i] - box[0]), abs(y + d * s[i] - box[1])) <= box[2]:
                    ranges[i] = d
                    break
    return LaserScan((x, y, z), START_RAD, 2 * math.pi / N, ranges.astype(np.float32), np.ones(N, bool))


def view(scan, seq=0, source="robot/r", depth_m=0.0):
    T = np.eye(4)
    T[:3, :3] = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    x, y, _ = scan.origin_m if scan is not None else (0.0, 0.0, 0.2)
    T[:3, 3] = x, y, 0.88
    camera = Pinhole.from_hfov(40, 30, 1.2)
    depth = np.full((30, 40), depth_m, np.float32)
    return PosedView(
        source, 0, seq, seq, "0", T, camera, 0.88, np.zeros((30, 40, 3), np.uint8), depth, (0.3, 5.0), scan=scan
    )


def occupied(floor, x, y):
    row, col = floor.grid.cells_of((x, y))
    return bool(floor.occupied()[row, col])


def mapped(*views):
    floor = FloorMap("0", 0.0, (0.0, 0.0), CONFIG)
    for one in views:
        floor.integrate(one)
    return floor


def test_walls_behind_the_camera_block_after_two_scans():
    once = mapped(view(room_scan()))
    assert not once.occupied().any()
    twice = mapped(view(room_scan()), view(room_scan(0.05)))
    assert occupied(twice, -2.0, 0.01)
    assert not occupied(twice, -1.0, 0.01)
    assert not twice.explored()[twice.occupied() != 0].any(), "a scan doesn't say what a place looks like"


def test_what_has_gone_is_free_again_and_what_stays_stays():
    there, gone = room_scan(box=(1.0, 1.0, 0.15)), room_scan()
    floor = mapped(*(view(there, i) for i in range(3)))
    assert occupied(floor, 0.86, 0.86)
    for i in range(7):
        floor.integrate(view(gone, 3 + i))
    assert not occupied(floor, 0.86, 0.86)
    assert occupied(floor, 2.0, 0.01)


def test_beams_below_a_table_top_clear_nothing_that_depth_shows():
    table = view(None, depth_m=1.0)  # a wall of points at 1 m, at all heights that the camera sees
    floor = mapped(*(replace(table, seq=i, stamp_ns=i) for i in range(3)))
    seen = floor.occupied().copy()
    assert seen.any()
    for i in range(30):
        floor.integrate(replace(view(room_scan(), 3 + i), depth_m=np.zeros((30, 40), np.float32)))
    after = np.zeros_like(seen)
    row, col = floor.grid.cells_of((0.0, 0.0)) - mapped(table).grid.cells_of((0.0, 0.0))
    part = floor.occupied()[row : row + seen.shape[0], col : col + seen.shape[1]]
    after[: part.shape[0], : part.shape[1]] = part
    assert (after[seen != 0] == 1).all()


@pytest.mark.parametrize(("z", "source"), [(0.05, "robot/r"), (1.5, "robot/r"), (0.2, "camera/c")])
def test_scans_at_other_heights_and_of_cameras_count_nothing(z, source):
    scan = room_scan(z=z)
    floor = mapped(*(view(scan, i, source) for i in range(5)))
    assert not floor.occupied().any()


def test_a_range_beyond_what_counts_frees_but_blocks_nothing():
    far = room_scan(half_m=8.0)
    floor = mapped(*(view(far, i) for i in range(4)))
    assert not floor.occupied().any()
    assert floor.state()["layers"]["scan_passes"].any()


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000))
def test_the_order_of_scans_and_a_restart_change_nothing(seed):
    rng = np.random.default_rng(seed)
    views = [view(room_scan(*rng.uniform(-1.5, 1.5, 2), box=(0.3, 0.4, 0.2)), i) for i in range(5)]
    floor, other = mapped(*views), mapped(*(views[i] for i in rng.permutation(5)))
    again = FloorMap.from_state(mapped(*views[:2]).state(), CONFIG)
    for one in views[2:]:
        again.integrate(one)

    def cells(f):
        return {tuple(c) for c in np.round(f.grid.centres_of(np.argwhere(f.occupied())), 3)}

    assert cells(floor) == cells(other) == cells(again)
    assert cells(floor)


def test_a_store_from_before_there_were_scans_is_read():
    state = mapped(view(None, depth_m=1.0)).state()
    del state["layers"]["scan_hits"], state["layers"]["scan_passes"]
    floor = FloorMap.from_state(state, CONFIG)
    floor.integrate(view(room_scan()))
    floor.integrate(view(room_scan()))
    assert occupied(floor, -2.0, 0.01)
