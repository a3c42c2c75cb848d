"""Depth as bytes: ``depth-invq-zstd``, of every pixel or of cells of several pixels.

Inverse depth in steps of ``quantum_per_m`` (uint16; 0: none), as the difference to the left neighbour (in the first column: to
the pixel above), folded to an unsigned number (zigzag); all low bytes, then all high bytes; zstd, with its checksum, so that
damaged depth is refused. A step q in 1/z is q·z² in z, which grows with distance as the noise of structured-light and stereo
sensors does (Nguyen, Izadi & Lovell 2012: sigma = 1.2 mm + 1.9 mm/m² · (z - 0.4 m)²). The largest error of a pixel is half a
step, q·z²/2:

    z [m]                            0.5    1     2     3     5     10
    sensor's sigma [mm]              1.2    1.9   6.1   14    41    176
    largest error [mm], q = 0.001/m  0.13   0.5   2     4.5   12.5  50
    largest error [mm], q = 0.006/m  0.75   3     12    27    75    300

With ``divisor`` d > 1 each square of d x d pixels is one cell: the median of its inverse depths, or none if less than half of it
has depth. Inverse depth is an affine function of the pixel on every plane, so interpolating cells restores planes exactly, and
the median of many pixels has less noise than each of them. Between cells that don't continue one another, at the edges of things,
nothing is interpolated: each pixel gets the depth of its own cell. Where ``divisor`` doesn't divide the picture's size, the cells
at its right and lower edge are smaller, and what is interpolated there is off by up to half a cell's slope.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import zstandard
from numpy.typing import NDArray

from surveilnav.errors import WireError
from surveilnav.sensing.limits import MAX_DIVISOR, check_pixels, unzstd

DEPTH_QUANTUM_PER_M: Final = 0.001
#: Neighbouring cells continue one another if their steps differ by no more than this many quanta from those beside them.
_SMOOTH_QUANTA = 3.0


def encode_depth(
    depth_m: NDArray[np.floating],
    depth_range_m: tuple[float, float],
    *,
    divisor: int = 1,
    quantum_per_m: float = DEPTH_QUANTUM_PER_M,
) -> bytes:
    """Encodes depth (height, width) [m]. Values that aren't finite or in range become "none"."""
    near, far = _checked(depth_range_m, divisor, quantum_per_m)
    depth = np.ascontiguousarray(depth_m, dtype=np.float32)
    if depth.ndim != 2:
        raise ValueError(f"a depth image is (height, width), got {depth.shape}")
    with np.errstate(invalid="ignore"):
        valid = (depth >= near) & (depth <= far)  # False for NaN
    inverse = np.reciprocal(np.where(valid, depth, np.float32(1.0)))
    if divisor > 1:
        inverse, valid = _cells(inverse, valid, divisor)
    inverse *= np.float32(1.0 / quantum_per_m)
    inverse += np.float32(0.5)
    q = inverse.astype(np.uint16)
    np.maximum(q, 1, out=q)
    q *= valid
    delta = q.copy()
    delta[:, 1:] -= q[:, :-1]
    delta[1:, 0] -= q[:-1, 0]
    signed = delta.view(np.int16)
    folded = ((signed << 1) ^ (signed >> 15)).view(np.uint16)
    level = 1 if divisor == 1 else 19  # small pictures are quick even so
    return zstandard.ZstdCompressor(level=level, write_checksum=True).compress(to_byte_planes(folded))


def decode_depth(
    data: bytes,
    width_px: int,
    height_px: int,
    depth_range_m: tuple[float, float],
    *,
    divisor: int = 1,
    quantum_per_m: float = DEPTH_QUANTUM_PER_M,
) -> NDArray[np.float32]:
    """Decodes depth to (height, width) float32 [m], 0 where there is none; other values lie within ``depth_range_m``.

    Raises:
        WireError: the data isn't ``depth-invq-zstd`` of these dimensions, or range, divisor or quantum make no sense.
    """
    check_pixels(width_px, height_px)
    try:
        near, far = _checked(depth_range_m, divisor, quantum_per_m)
    except ValueError as error:
        raise WireError(str(error)) from None
    rows, cols = -(-height_px // divisor), -(-width_px // divisor)
    folded = from_byte_planes(unzstd(data, 2 * rows * cols), (rows, cols))
    delta = (folded >> 1) ^ (-(folded & 1).view(np.int16)).view(np.uint16)
    delta[:, 0] = np.cumsum(delta[:, 0], dtype=np.uint16)
    steps = np.cumsum(delta, axis=1, dtype=np.uint16)
    table = _depth_table(near, far, quantum_per_m)
    depth_m = table.take(steps, mode="wrap")  # the table has an entry for every step: no need to check them
    return depth_m if divisor == 1 else _enlarged(depth_m, divisor, quantum_per_m, (near, far))[:height_px, :width_px]


def finest_quantum_per_m(nearest_m: float) -> float:
    """The smallest step of inverse depth with which depth from ``nearest_m`` on can be encoded."""
    return 1.0 / (65535 * nearest_m)


def to_byte_planes(values: NDArray[np.uint16]) -> bytes:
    """All low bytes, then all high bytes: smooth pictures become runs, which compress well."""
    return np.stack([values.astype(np.uint8), (values >> 8).astype(np.uint8)]).tobytes()


def from_byte_planes(data: bytes, shape: tuple[int, int]) -> NDArray[np.uint16]:
    """Inverse of ``to_byte_planes``. Raises ValueError if ``data`` doesn't have this shape."""
    low, high = np.frombuffer(data, np.uint8).reshape(2, *shape)
    values = high.astype(np.uint16)
    values <<= 8
    values |= low
    return values


def _cells(
    inverse: NDArray[np.float32], valid: NDArray[np.bool_], divisor: int
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The median inverse depth of each cell (rows, cols), and whether at least half of its pixels have one."""
    down, right = -inverse.shape[0] % divisor, -inverse.shape[1] % divisor
    known = np.pad(np.where(valid, inverse, np.float32(np.inf)), ((0, down), (0, right)), constant_values=np.inf)
    rows, cols = known.shape[0] // divisor, known.shape[1] // divisor
    pixels = known.reshape(rows, divisor, cols, divisor).swapaxes(1, 2).reshape(rows, cols, -1)
    n = np.isfinite(pixels).sum(axis=2)
    middle = np.maximum(n - 1, 0) // 2
    median = np.take_along_axis(np.sort(pixels, axis=2), middle[..., None], axis=2)[..., 0]
    enough = n >= divisor * divisor / 2
    return np.where(enough, median, np.float32(0.0)).astype(np.float32), enough


def _enlarged(
    cells_m: NDArray[np.float32], divisor: int, quantum_per_m: float, depth_range_m: tuple[float, float]
) -> NDArray[np.float32]:
    """Depth of every pixel (rows * divisor, cols * divisor): between the centres of cells that continue one another it is
    interpolated, elsewhere it is that of the cell."""
    (rows, cols), (near, far) = cells_m.shape, depth_range_m
    known = cells_m > 0
    inverse = np.where(known, 1.0 / np.where(known, cells_m, 1.0), np.nan).astype(np.float32)
    if rows > 1 and cols > 1:
        inverse = np.pad(inverse, 1, mode="reflect", reflect_type="odd")  # continues what the outermost cells begin
    else:
        inverse = np.pad(inverse, 1, mode="edge")
    across, down = _continues(inverse, quantum_per_m), _continues(inverse.T, quantum_per_m).T
    smooth = across[:-1] & across[1:] & down[:, :-1] & down[:, 1:]  # (rows + 1, cols + 1) squares between four centres
    at = (np.arange(divisor, dtype=np.float32) + np.float32(0.5)) / divisor + np.float32(
        0.5
    )  # from the square above left
    out = np.repeat(np.repeat(cells_m, divisor, axis=0), divisor, axis=1).reshape(rows, divisor, cols, divisor)
    half = divisor // 2  # pixels whose centre lies before that of the cell
    for below, ys in ((0, slice(0, half)), (1, slice(half, divisor))):
        for right, xs in ((0, slice(0, half)), (1, slice(half, divisor))):
            squares = np.s_[below : below + rows, right : right + cols]
            fy, fx = (at[ys] - below)[None, :, None, None], (at[xs] - right)[None, None, None, :]
            corner = [
                inverse[dy + below : dy + below + rows, dx + right : dx + right + cols]
                for dy in (0, 1)
                for dx in (0, 1)
            ]
            a, b, c, d = (x[:, None, :, None] for x in corner)
            value = (a * (1 - fx) + b * fx) * (1 - fy) + (c * (1 - fx) + d * fx) * fy
            ok = smooth[squares][:, None, :, None] & (value >= 1.0 / far) & (value <= 1.0 / near)
            np.copyto(out[:, ys, :, xs], np.reciprocal(np.where(ok, value, np.float32(1.0))), where=ok)
    return out.reshape(rows * divisor, cols * divisor)


def _continues(inverse: NDArray[np.float32], quantum_per_m: float) -> NDArray[np.bool_]:
    """Whether horizontal neighbours lie on one surface: (n, m - 1) for (n, m) inverse depths, NaN where there is none.

    They do where the step between them is that beside it, on either side, but for rounding.
    """
    step = np.diff(inverse, axis=1)
    change = np.abs(np.diff(step, axis=1))
    change = np.where(np.isnan(change), np.inf, change)
    nothing = np.full((len(step), 1), np.inf, np.float32)
    beside = np.minimum(np.hstack([nothing, change]), np.hstack([change, nothing]))
    return np.asarray(beside <= _SMOOTH_QUANTA * quantum_per_m)


def _depth_table(near_m: float, far_m: float, quantum_per_m: float) -> NDArray[np.float32]:
    """Depth of each step, (65536,) float32. Steps outside the range, by more than rounding, are "none"."""
    inverse_depth = np.arange(65536) * quantum_per_m
    inverse_depth[0] = np.inf  # none
    slack = 0.51 * quantum_per_m
    valid = (inverse_depth <= 1 / near_m + slack) & (inverse_depth >= 1 / far_m - slack)
    valid[1] |= 1 / far_m < 1.5 * quantum_per_m
    depth = np.clip(1.0 / inverse_depth, near_m, far_m)
    return np.where(valid, depth, 0.0).astype(np.float32)


def _checked(depth_range_m: tuple[float, float], divisor: int, quantum_per_m: float) -> tuple[float, float]:
    near, far = (float(v) for v in depth_range_m)
    if not (0.02 <= near < far <= 1000.0):  # False for NaN
        raise ValueError(f"a depth range needs 0.02 m <= nearest < farthest <= 1000 m, got ({near}, {far})")
    if not 1 <= divisor <= MAX_DIVISOR:
        raise ValueError(f"a cell has 1 to {MAX_DIVISOR} pixels a side, got {divisor}")
    if not finest_quantum_per_m(near) <= quantum_per_m <= 0.1:  # False for NaN
        raise ValueError(
            f"a step of inverse depth is at most 0.1/m, and 65,535 of them reach {near} m; got {quantum_per_m}/m"
        )
    return near, far
