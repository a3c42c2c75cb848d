"""Map layers from the bus: what a hostile header can't do."""

from __future__ import annotations

import numpy as np
import pytest

from surveilnav.errors import WireError
from surveilnav.geometry import Grid
from surveilnav.messages import LayerHeader
from surveilnav.sensing.layers import unpack_layer
from surveilnav.sensing.packing import pack_array


def header(**changes: object) -> LayerHeader:
    facts: dict[str, object] = {
        "stamp_ns": 1,
        "floor": "0",
        "layer": "explored",
        "revision": 1,
        "grid": Grid(0, 0, 0.05, 4, 5),
        "dtype": "uint8",
        "shape": (4, 5),
    }
    return LayerHeader(**(facts | changes))  # type: ignore[arg-type]


def test_a_layer_survives_the_wire():
    cells = np.arange(20, dtype=np.uint8).reshape(4, 5)
    assert (unpack_layer("explored", header(), pack_array(cells)) == cells).all()


@pytest.mark.parametrize(
    "changes",
    [
        {"shape": (5, 4)},
        {"shape": (4, 5, 1)},
        {"dtype": "float32"},
        {"layer": "value"},
        {"layer": "cloud"},
        {"grid": Grid(0, 0, 0.05, 65536, 65536), "shape": (65536, 65536)},
    ],
)
def test_headers_that_dont_fit_are_wire_errors(changes):
    with pytest.raises(WireError):
        unpack_layer("explored", header(**changes), pack_array(np.zeros((4, 5), np.uint8)))


def test_a_layer_that_isnt_on_a_grid_is_no_layer_here():
    cloud = header(layer="cloud", dtype="float32", shape=(4, 6))
    with pytest.raises(WireError, match="cloud"):
        unpack_layer("cloud", cloud, pack_array(np.zeros((4, 6), np.float32)))


@pytest.mark.parametrize(
    "grid", [Grid(0.0, 0.0, 1e-300, 4, 4), Grid(0.0, 0.0, 1e30, 4, 4), Grid(1e308, 0.0, 0.1, 4, 4)]
)
def test_a_grid_that_no_building_has_is_refused(grid: Grid) -> None:
    cells = np.zeros((4, 4), np.uint8)
    header = LayerHeader(
        stamp_ns=1, floor="0", layer="explored", revision=1, grid=grid, dtype="uint8", shape=cells.shape
    )
    with pytest.raises(WireError, match="expected cells from 1 mm"):
        unpack_layer("explored", header, pack_array(cells))
