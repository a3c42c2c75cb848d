"""Pictures of layers (orientation, colours and sizes), and clouds of few points, spread evenly."""

from __future__ import annotations

import io

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.geometry import Grid
from surveilnav.occupancy import ESTIMATED_OBSTACLE, OBSTACLE, PRIOR_FREE, PRIOR_OBSTACLE
from surveilnav.sensing.layers import GRID_LAYERS
from surveilnav.services.gateway.core.layers import COLOURS, as_array, colour_values, render, thinned_cloud, transform


def decode(png: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)[..., [2, 1, 0, 3]]


@given(
    rows=st.integers(1, 12),
    cols=st.integers(1, 12),
    seed=st.integers(0, 99),
    layer=st.sampled_from(["occupancy", "explored", "frontier"]),
)
def test_a_pixel_is_a_cell_and_north_is_up(rows, cols, seed, layer):
    cells = np.random.default_rng(seed).integers(0, 2, (rows, cols)).astype(np.uint8)
    picture = decode(render(layer, Grid(0, 0, 0.05, rows, cols), cells).data)
    for row in range(rows):
        for col in range(cols):
            expected = (*COLOURS[layer], 255) if cells[row, col] else (0, 0, 0, 0)
            assert tuple(picture[rows - 1 - row, col]) == expected


def test_values_grow_brighter_and_unknown_is_transparent():
    values = np.array([[np.nan, -1.0, 0.0], [0.5, 1.0, np.inf]], np.float32)
    rgba, low, high = colour_values(values)
    assert (low, high) == (-1.0, 1.0)
    assert (rgba[..., 3] > 0).tolist() == [[False, True, True], [True, True, False]]
    luminance = rgba[..., :3].astype(float) @ [0.2126, 0.7152, 0.0722]
    assert luminance[0, 1] < luminance[0, 2] < luminance[1, 0] < luminance[1, 1]


@pytest.mark.parametrize("values", [np.full((2, 2), np.nan), np.full((2, 2), 0.3)])
def test_values_without_a_range(values):
    picture = render("value", Grid(0, 0, 1, 2, 2), values.astype(np.float32))
    assert (decode(picture.data)[..., 3] > 0).all() == np.isfinite(values).all()


@pytest.mark.parametrize(("layer", "dtype"), [("occupancy", np.uint8), ("value", np.float32)])
def test_large_maps_are_joined_and_keep_thin_walls(layer, dtype):
    cells = np.full((301, 299), np.nan if layer == "value" else 0, dtype)
    cells[150] = 1
    picture = render(layer, Grid(-3.0, 2.0, 0.05, 301, 299), cells, max_pixels=10_000)
    assert picture.grid == Grid(-3.0, 2.0, 0.05 * 3, 101, 100)
    rgba = decode(picture.data)
    assert rgba.shape == (101, 100, 4)
    assert (rgba[..., 3] > 0).any(axis=1).sum() == 1
    assert (rgba[101 - 1 - 150 // 3, :, 3] == 255).all()


def test_every_layer_on_a_grid_has_a_picture():
    assert set(COLOURS) == set(GRID_LAYERS)


@pytest.mark.parametrize("layer", ["occupancy", "value"])
def test_an_array_is_what_fusion_sent_and_lies_where_the_grid_does(layer):
    grid = Grid(-1.0, -2.0, 0.5, 3, 4)
    cells = np.arange(12, dtype=np.float32 if layer == "value" else np.uint8).reshape(3, 4)
    if layer == "value":
        cells[0, 0] = np.nan
    drawn = as_array(layer, grid, cells)
    np.testing.assert_array_equal(np.load(io.BytesIO(drawn.data), allow_pickle=False), cells)
    assert (drawn.low, drawn.high) == ((1.0, 11.0) if layer == "value" else (None, None))
    for row, col in np.ndindex(3, 4):
        x_m, y_m, one = np.array(transform(grid)) @ (col, row, 1)
        assert one == 1
        np.testing.assert_allclose((x_m, y_m), grid.centres_of((row, col)))


# --- clouds -------------------------------------------------------------------------------------------------------

CLOUD = np.random.default_rng(0).random((5000, 6), np.float32) * np.array([8, 6, 2.5, 1, 1, 1], np.float32)


@pytest.mark.parametrize("most", [1, 50, 1000, 4999])
def test_few_points_of_the_cloud_itself_whatever_their_order(most):
    few = thinned_cloud(CLOUD, most)
    assert most / 8 < len(few) <= most
    rows = {row.tobytes() for row in CLOUD}
    assert all(row.tobytes() in rows for row in few)
    shuffled = np.random.default_rng(1).permutation(CLOUD)
    assert np.array_equal(thinned_cloud(shuffled, most), few)


def test_they_are_spread_evenly():
    crowded = np.concatenate([CLOUD[:500], np.full((50_000, 6), 0.5, np.float32) + CLOUD[:1] * 1e-6])
    few = thinned_cloud(crowded, 600)
    assert len(few) > 400, "a crowd of points takes the room of one"


def test_what_fits_is_whole_and_what_is_no_place_is_left_out():
    odd = CLOUD[:4].copy()
    odd[0, 0], odd[1, 2], odd[2, 4] = np.nan, 1e30, np.inf
    assert np.array_equal(thinned_cloud(odd, 10), CLOUD[3:4])
    assert thinned_cloud(np.zeros((0, 6), np.float32), 10).shape == (0, 6)


def test_an_obstacle_that_is_only_estimated_is_paler():
    cells = np.array([[0, OBSTACLE, ESTIMATED_OBSTACLE]], np.uint8)
    alpha = decode(render("occupancy", Grid(0, 0, 1, 1, 3), cells).data)[0, :, 3]
    assert alpha[0] == 0 < alpha[2] < alpha[1]


def test_what_only_a_map_from_before_has_is_in_a_colour_of_its_own():
    cells = np.array([[0, OBSTACLE, PRIOR_OBSTACLE, PRIOR_FREE]], np.uint8)
    rgba = decode(render("occupancy", Grid(0, 0, 1, 1, 4), cells).data)[0]
    assert tuple(rgba[2, :3]) == tuple(rgba[3, :3]) != tuple(rgba[1, :3])
    assert rgba[0, 3] == 0 < rgba[3, 3] < rgba[2, 3] < rgba[1, 3]
    few = render("occupancy", Grid(0, 0, 1, 2, 4), np.vstack([cells, cells]), max_pixels=2)
    assert (decode(few.data)[..., 3] > 0).all(), "coarser, walls still show"
    assert tuple(decode(few.data)[0, 0, :3]) == tuple(rgba[1, :3])
