"""Decodes map layers from the bus, after checking header and payload against each other."""

from __future__ import annotations

from numpy.typing import NDArray

from surveilnav.errors import WireError
from surveilnav.geometry import Grid
from surveilnav.messages import FloorMapsHeader, LayerHeader
from surveilnav.sensing.packing import unpack_array

#: Layers on a grid, and the type of their cells: 0 or 1, or a value with NaN where it is unknown.
GRID_LAYERS = {"occupancy": "uint8", "explored": "uint8", "frontier": "uint8", "value": "float32"}


def unpack_layer(layer: str, header: LayerHeader, payload: bytes) -> NDArray:
    """The cells (rows, cols) of a grid layer; row 0 is the southernmost.

    Raises:
        WireError: it is another layer, or header and payload don't fit each other.
    """
    if layer not in GRID_LAYERS or header.layer != layer:
        raise WireError(f"expected the layer {layer!r} of {', '.join(GRID_LAYERS)}, got {header.layer!r}")
    _check_grid(header.grid)
    expected = GRID_LAYERS[layer]
    if header.dtype != expected or header.shape != header.grid.shape:
        raise WireError(
            f"expected {layer} as {expected} of shape {header.grid.shape}, got {header.dtype} {header.shape}"
        )
    return unpack_array(payload, header.dtype, header.shape)


def unpack_parts(header: FloorMapsHeader, payload: bytes) -> dict[str, NDArray]:
    """The layers (rows, cols) in the maps of a floor, by name.

    Raises:
        WireError: header and payload don't fit each other.
    """
    _check_grid(header.grid)
    layers: dict[str, NDArray] = {}
    begin = 0
    for part in header.layers:
        if part.dtype != GRID_LAYERS[part.layer] or part.shape != header.grid.shape or part.n_bytes < 0:
            expected = f"{GRID_LAYERS[part.layer]} of shape {header.grid.shape}"
            raise WireError(f"expected {part.layer} as {expected}, got {part.dtype} {part.shape}, {part.n_bytes} bytes")
        layers[part.layer] = unpack_array(payload[begin : begin + part.n_bytes], part.dtype, part.shape)
        begin += part.n_bytes
    if begin != len(payload):
        raise WireError(f"expected {begin} bytes of layers, got {len(payload)}")
    return layers


def _check_grid(grid: Grid) -> None:
    """Raises WireError for cells of a size, or in a place, that no building has: what divides by them would overflow."""
    if not 0.001 <= grid.resolution_m <= 100.0 or max(abs(grid.origin_x_m), abs(grid.origin_y_m)) > 1e6:
        raise WireError(f"expected cells from 1 mm to 100 m, within 1,000 km of the origin, got {grid}")


def unpack_cloud(header: LayerHeader, payload: bytes) -> NDArray:
    """The points (N, 6) float32 of the cloud: x, y, z [m, world] and r, g, b [0-1].

    Raises:
        WireError: it is another layer, or header and payload don't fit each other.
    """
    if header.layer != "cloud" or header.dtype != "float32" or len(header.shape) != 2 or header.shape[1] != 6:
        raise WireError(f"expected the cloud as float32 (N, 6), got {header.layer!r} {header.dtype} {header.shape}")
    return unpack_array(payload, header.dtype, header.shape)
