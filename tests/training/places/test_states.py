"""States are read as they were written, and rows hold what is true."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from surveilnav.geometry import Grid, camera_pose
from surveilnav.services.planner.core import FloorMaps
from training.places.rows import rows_of
from training.places.states import EVERY_STEPS, StateWriter, TrueWays, read_states

GRID = Grid(-1.0, 2.0, 0.05, 81, 122)


def maps_of_a_room() -> FloorMaps:
    """A room of 4 x 3 m whose left and right sides are open."""
    occupancy, explored, frontier = (np.zeros(GRID.shape, np.uint8) for _ in range(3))
    explored[10:70, 20:100] = 1
    occupancy[10, 20:100] = occupancy[69, 20:100] = 1
    frontier[11:69, 20] = frontier[11:69, 99] = 1
    value = np.full(GRID.shape, np.nan, np.float32)
    value[30:40, 30:40] = 0.25
    return FloorMaps("0", 0.5, GRID, occupancy, explored, frontier, value, [], 1)


@pytest.fixture
def state(tmp_path):
    writer, view = StateWriter("chair"), SimpleNamespace(T_world_camera=camera_pose((2.0, 4.0, 1.4), 0.7, 0.0))
    for seq in range(2 * EVERY_STEPS):
        writer.on_step(seq, view, None, maps_of_a_room(), None)
    writer.write(tmp_path / "a.npz")
    states = list(read_states(tmp_path / "a.npz"))
    assert [s.step for s in states] == [1, 1 + EVERY_STEPS]
    return states[0]


def test_a_state_is_read_as_it_was_written(state):
    maps = maps_of_a_room()
    assert (state.searched, state.maps.grid, state.maps.floor_z_m) == ("chair", GRID, 0.5)
    for name in ("occupancy", "explored", "frontier"):
        assert np.array_equal(getattr(state.maps, name), getattr(maps, name))
    assert state.robot.x_m == pytest.approx(2.0)
    assert state.robot.yaw_rad == pytest.approx(0.7)
    known = np.isfinite(maps.value)
    assert state.maps.value[known] == pytest.approx(0.25)
    assert state.maps.value.shape == maps.value.shape


def truth_at(path, distance_m) -> TrueWays:
    grids = json.dumps({"0": [GRID.origin_x_m, GRID.origin_y_m, GRID.resolution_m, GRID.rows, GRID.cols]})
    np.savez_compressed(
        path, grids=np.frombuffer(grids.encode(), np.uint8), **{"chair/0": distance_m.astype(np.float16)}
    )
    return TrueWays(path)


def test_rows_hold_the_true_way_beyond_each_frontier(state, tmp_path):
    cols = np.arange(GRID.cols) * GRID.resolution_m
    rows = rows_of(state, truth_at(tmp_path / "truth.npz", np.broadcast_to(cols, GRID.shape)))
    assert rows is not None
    chair, others = rows["left_m"][:, 2], np.delete(rows["left_m"], 2, axis=1)
    assert sorted(set(np.round(chair))) == [1.0, 5.0], "the left side is 1 m from the chair, the right side 5 m"
    assert np.isnan(others).all(), "the building has nothing else"
    assert set(rows["searched"]) == {2.0}


def test_a_place_in_a_wall_is_as_far_as_the_best_free_place_beside_it(tmp_path):
    distance_m = np.full(GRID.shape, np.inf)
    distance_m[:, 60:] = 3.0
    truth = truth_at(tmp_path / "truth.npz", distance_m)
    assert truth.left_m("chair", "0", 3.0, 4.0) == 3.0
    assert truth.left_m("chair", "0", 1.8, 4.0) == 3.5
    assert np.isinf(truth.left_m("chair", "0", 0.0, 4.0))
    assert truth.categories() == {"chair"}
