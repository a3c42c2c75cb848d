"""Map layers read without numpy: the same numbers as numpy reads, and a named error for what is no such file."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from surveilnav.client.npy import array_of, rows_of
from surveilnav.errors import ConfigError, GatewayError
from surveilnav.services.gateway.core.layers import npy

TABLES = st.sampled_from([np.uint8, np.float32, np.float64]).flatmap(
    lambda kind: arrays.arrays(kind, arrays.array_shapes(min_dims=2, max_dims=2, max_side=9))
)


@given(TABLES)
def test_rows_are_those_that_numpy_reads(table):
    data = npy(table)
    np.testing.assert_array_equal(array_of(data), table)
    rows = rows_of(data)
    assert [len(row) for row in rows] == [table.shape[1]] * table.shape[0]
    np.testing.assert_array_equal(np.array([row.tolist() for row in rows], dtype=table.dtype), table)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"<html>",
        npy(np.zeros((2, 2), np.uint8))[:-1],
        npy(np.zeros((2, 2), np.uint8)) + b"x",
        npy(np.zeros(4, np.uint8)),
        npy(np.zeros((2, 2), np.int64)),
        npy(np.zeros((2, 3), np.float32)).replace(b"'fortran_order': False", b"'fortran_order': True "),
        b"\x94" + npy(np.zeros((2, 2), np.uint8))[1:],
    ],
    ids=["empty", "a page", "cut", "too long", "one dimension", "another type", "by columns", "another magic"],
)
def test_what_is_no_layer_is_refused(data):
    with pytest.raises(GatewayError, match=r"expected a \.npy file"):
        rows_of(data)


def test_who_asks_for_an_array_without_numpy_is_told_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "numpy", None)
    with pytest.raises(ConfigError, match="pip install numpy"):
        array_of(b"")


@pytest.mark.parametrize(
    "data", [b"", b"\x93NUMPY\x01\x00\x10\x00{'descr': '<f4',", b"\x93NUMPY", b"nothing of the kind"]
)
def test_what_is_no_array_is_refused_by_name(data: bytes) -> None:
    for read in (array_of, rows_of):
        with pytest.raises(GatewayError, match=r"expected a \.npy file"):
            read(data)


def test_rows_without_cells_are_refused() -> None:
    header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000, 0)}"
    with pytest.raises(GatewayError, match=r"expected a \.npy file"):
        rows_of(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
