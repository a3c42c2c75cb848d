"""Depth in cells of several pixels: planes come back exactly, edges stay edges, and the error is what it is said to be."""

from __future__ import annotations

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from surveilnav.errors import WireError
from surveilnav.sensing.depth_codec import decode_depth, encode_depth, to_byte_planes

RANGE_M = (0.3, 10.0)


def back(depth_m: np.ndarray, divisor: int, quantum_per_m: float = 0.001) -> np.ndarray:
    height, width = depth_m.shape
    data = encode_depth(depth_m, RANGE_M, divisor=divisor, quantum_per_m=quantum_per_m)
    return decode_depth(data, width, height, RANGE_M, divisor=divisor, quantum_per_m=quantum_per_m)


@settings(max_examples=60, deadline=None)
@given(
    st.floats(0.3, 1.0),
    st.floats(-0.001, 0.001),
    st.floats(-0.001, 0.001),
    st.integers(2, 16),
    st.integers(3, 12),
    st.integers(3, 12),
)
def test_a_plane_comes_back_within_its_rounding(inverse, across, down, divisor, rows, cols):
    """A plane's inverse depth is affine in the pixel. The median of a cell is off by up to half a pixel's slope, and its rounding
    by half a quantum; interpolating adds nothing, continuing at the edge of the picture up to twice as much."""
    v, u = np.mgrid[: rows * divisor, : cols * divisor]
    truth = inverse + across * u + down * v
    truth = np.clip(truth, 1 / RANGE_M[1], 1 / RANGE_M[0])
    if truth.min() <= 1 / RANGE_M[1] or truth.max() >= 1 / RANGE_M[0]:
        return  # clipped: no plane any more
    error = np.abs(1.0 / back((1.0 / truth).astype(np.float32), divisor, 0.006) - truth)
    assert error.max() <= 4 * (0.003 + abs(across) + abs(down)) + 1e-6


def test_a_steep_plane_is_interpolated():
    v, u = np.mgrid[:160, :160]
    truth = 0.3 + 0.004 * u + 0.003 * v
    error = np.abs(1.0 / back((1.0 / truth).astype(np.float32), 16, 0.006) - truth)
    assert error.max() < 0.02, "without interpolation it is 0.05 at the corners of cells"


def test_nothing_is_interpolated_across_an_edge():
    depth_m = np.full((64, 64), 4.0, np.float32)
    depth_m[:, 32:] = 1.0
    found = back(depth_m, 8)
    assert np.allclose(found[:, :32], 4.0, atol=0.02)
    assert np.allclose(found[:, 32:], 1.0, atol=0.02)


def test_an_edge_within_a_cell_falls_to_the_larger_side():
    depth_m = np.full((64, 64), 4.0, np.float32)
    depth_m[:, 34:] = 1.0
    found = back(depth_m, 8)
    assert set(np.round(np.unique(found), 1)) == {1.0, 4.0}
    assert np.allclose(found[:, 33], 1.0, atol=0.02)  # two of its cell's eight columns are far


@pytest.mark.parametrize(("n_known", "is_known"), [(32, True), (31, False)])
def test_a_cell_has_depth_if_half_of_it_has(n_known, is_known):
    depth_m = np.zeros(64, np.float32)
    depth_m[:n_known] = 2.0
    assert (back(depth_m.reshape(8, 8), 8) > 0).all() == is_known


def test_a_cell_is_the_median_of_its_pixels():
    """The literal reading of the format: noise of single pixels and those without depth don't count."""
    random = np.random.default_rng(1)
    depth_m = random.uniform(1.0, 3.0, (4, 4)).astype(np.float32)
    depth_m[0, :3] = 0.0
    known = sorted(1.0 / depth_m[depth_m > 0])
    assert 1.0 / back(depth_m, 4)[0, 0] == pytest.approx(known[(len(known) - 1) // 2], abs=0.00051)


def test_many_pixels_have_less_noise_than_one():
    random = np.random.default_rng(2)
    depth_m = (2.0 + random.normal(0.0, 0.02, (160, 160))).astype(np.float32)
    assert np.std(back(depth_m, 8)) < 0.005


@pytest.mark.parametrize("divisor", [1, 3, 8, 64])
def test_pictures_of_any_size_keep_their_size(divisor):
    for shape in ((1, 1), (7, 130), (130, 7)):
        assert back(np.full(shape, 2.0, np.float32), divisor).shape == shape


@pytest.mark.parametrize(
    ("divisor", "quantum_per_m"), [(0, 0.001), (-8, 0.001), (65, 0.001), (8, 0.0), (8, float("nan")), (8, 1.0)]
)
def test_numbers_that_make_no_sense_are_refused(divisor, quantum_per_m):
    data = encode_depth(np.full((64, 64), 2.0, np.float32), RANGE_M, divisor=8)
    with pytest.raises(WireError):
        decode_depth(data, 64, 64, RANGE_M, divisor=divisor, quantum_per_m=quantum_per_m)


@settings(max_examples=100, deadline=None)
@given(
    st.integers(1, 64),
    hnp.arrays(np.uint16, hnp.array_shapes(min_dims=2, max_dims=2, max_side=6)),
    st.sampled_from([0.001, 0.006, 0.1]),
)
def test_whatever_the_cells_hold_depth_stays_in_range(divisor, folded, quantum_per_m):
    """Steps that no honest sender would write, well compressed."""
    rows, cols = folded.shape
    data = zstandard.compress(to_byte_planes(folded))
    depth_m = decode_depth(data, cols * divisor, rows * divisor, RANGE_M, divisor=divisor, quantum_per_m=quantum_per_m)
    known = depth_m[depth_m != 0]
    assert np.isfinite(known).all()
    assert ((known >= RANGE_M[0] * 0.999) & (known <= RANGE_M[1] * 1.001)).all()


def test_a_wall_isnt_continued_beyond_the_range():
    """An oblique wall that leaves the range within the outermost cell."""
    inverse = np.tile(np.linspace(0.14, 0.1, 64), (64, 1))
    assert back((1.0 / inverse).astype(np.float32), 16).max() <= RANGE_M[1]


def test_data_of_another_divisor_is_refused():
    data = encode_depth(np.full((64, 64), 2.0, np.float32), RANGE_M, divisor=8)
    with pytest.raises(WireError, match="bytes"):
        decode_depth(data, 64, 64, RANGE_M, divisor=4)
