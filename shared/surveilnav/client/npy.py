"""Arrays as the gateway sends them: numpy's .npy format, read with numpy where it is installed, or without."""

from __future__ import annotations

import ast
import io
import struct
import sys
from array import array
from tokenize import TokenError
from typing import TYPE_CHECKING, Any

from surveilnav.errors import ConfigError, GatewayError

if TYPE_CHECKING:
    from numpy.typing import NDArray

_MAGIC = b"\x93NUMPY\x01\x00"
_HEADER_AT = len(_MAGIC) + 2
#: numpy's name of a type, and that of the standard library's ``array``.
_TYPES = {"|u1": "B", "<f4": "f", "<f8": "d"}


def array_of(data: bytes) -> NDArray[Any]:
    """The array in a .npy file's bytes.

    Raises:
        ConfigError: numpy isn't installed.
        GatewayError: it is no such file.
    """
    try:
        import numpy as np
    except ModuleNotFoundError as error:
        raise ConfigError("arrays need numpy, which isn't installed: pip install numpy") from error
    try:
        found: NDArray[Any] = np.load(io.BytesIO(data), allow_pickle=False)
    except (ValueError, EOFError, OverflowError, SyntaxError, TokenError, MemoryError) as error:
        raise GatewayError("no_gateway", f"expected a .npy file, got {len(data)} bytes that are none") from error
    return found


def rows_of(data: bytes) -> list[memoryview]:
    """The rows of a two-dimensional array of uint8, float32 or float64 in a .npy file's bytes, without numpy.

    The format: https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html, version 1.0.

    Raises:
        GatewayError: it is no such file.
    """
    try:
        (length,) = struct.unpack_from("<H", data, len(_MAGIC))
        header = ast.literal_eval(data[_HEADER_AT : _HEADER_AT + length].decode("latin1"))
        rows, cols = header["shape"]
        cells = array(_TYPES[header["descr"]])
        cells.frombytes(data[_HEADER_AT + length :])
        if not data.startswith(_MAGIC) or header["fortran_order"] or len(cells) != rows * cols or rows > len(cells):
            raise ValueError
    except (struct.error, SyntaxError, ValueError, KeyError, TypeError, RecursionError, MemoryError) as error:
        what = "a .npy file with a table of uint8, float32 or float64"
        raise GatewayError("no_gateway", f"expected {what}, got {len(data)} bytes that are none") from error
    if sys.byteorder == "big":
        cells.byteswap()
    view = memoryview(cells)
    return [view[row * cols : (row + 1) * cols] for row in range(rows)]
