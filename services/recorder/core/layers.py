"""Map layers as Foxglove shows them: grids on the floor, and the point cloud."""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.Grid_pb2 import Grid as FoxgloveGrid
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Vector2_pb2 import Vector2

from surveilnav.errors import WireError
from surveilnav.messages import LayerHeader
from surveilnav.sensing.layers import unpack_layer
from surveilnav.sensing.packing import unpack_array
from surveilnav.services.recorder.core.mcap_message import McapMessage, encode_foxglove
from surveilnav.services.recorder.core.shapes import WORLD, to_timestamp, upright_pose

_TYPES = {"uint8": PackedElementField.UINT8, "float32": PackedElementField.FLOAT32}
#: More points of a cloud aren't recorded: they would be most of the file, and a replay makes them anew from the views.
_MAX_POINTS = 100_000
_POINT = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1"), ("alpha", "u1")]
)


def layer_message(header: LayerHeader, payload: bytes, floor_z_m: float, log_ns: int) -> McapMessage:
    """A layer of a floor. Raises WireError if its bytes don't match its header."""
    topic = f"/map/{header.floor}/{header.layer}"
    message = _cloud(header, payload) if header.layer == "cloud" else _grid(header, payload, floor_z_m)
    return encode_foxglove(topic, message, log_ns, header.stamp_ns)


def _grid(header: LayerHeader, payload: bytes, floor_z_m: float) -> FoxgloveGrid:
    cells = unpack_layer(header.layer, header, payload)
    size = cells.dtype.itemsize
    field = PackedElementField(name=header.layer, offset=0, type=_TYPES[header.dtype])
    grid = header.grid
    return FoxgloveGrid(
        timestamp=to_timestamp(header.stamp_ns),
        frame_id=WORLD,
        pose=upright_pose(grid.origin_x_m, grid.origin_y_m, floor_z_m),
        column_count=grid.cols,
        cell_size=Vector2(x=grid.resolution_m, y=grid.resolution_m),
        row_stride=grid.cols * size,
        cell_stride=size,
        fields=[field],
        data=np.ascontiguousarray(cells).tobytes(),
    )


def _cloud(header: LayerHeader, payload: bytes) -> PointCloud:
    if len(header.shape) != 2 or header.shape[1] != 6 or header.dtype != "float32":
        raise WireError(f"expected a cloud of shape (N, 6) float32, got {header.shape} {header.dtype}")
    every = max(1, -(-header.shape[0] // _MAX_POINTS))
    array = unpack_array(payload, header.dtype, header.shape)[::every]
    packed = np.zeros(len(array), _POINT)
    for i, name in enumerate(("x", "y", "z")):
        packed[name] = array[:, i]
    for i, name in enumerate(("red", "green", "blue")):
        packed[name] = np.clip(np.nan_to_num(array[:, 3 + i]) * 255, 0, 255)
    packed["alpha"] = 255
    offsets = [(name, *_POINT.fields[name]) for name in _POINT.names or ()]  # type: ignore[index]
    fields = [
        PackedElementField(name=name, offset=offset, type=_TYPES["float32" if kind.itemsize == 4 else "uint8"])
        for name, kind, offset in offsets
    ]
    return PointCloud(
        timestamp=to_timestamp(header.stamp_ns),
        frame_id=WORLD,
        pose=upright_pose(0.0, 0.0, 0.0),
        point_stride=_POINT.itemsize,
        fields=fields,
        data=packed.tobytes(),
    )
