"""Encodes pictures, depth, embeddings and arrays as bytes, and decodes them.

Data from the network may be malicious: sizes are checked before anything is decompressed, and any fault raises ``WireError``.

Depth is encoded as ``depth-invq-zstd``: inverse depth in steps of ``DEPTH_QUANTUM_PER_M`` (uint16; 0: none), as the
difference to the left neighbour (in the first column: to the pixel above), folded to an unsigned number (zigzag); all low
bytes, then all high bytes; zstd. A step q in 1/z is q·z² in z, which grows with distance as the noise of structured-light
and stereo sensors does (Nguyen, Izadi & Lovell 2012: sigma = 1.2 mm + 1.9 mm/m² · (z - 0.4 m)²). With q = 0.001/m the
largest error is z²/2000:

    z [m]                0.5    1     2     3     5     10
    largest error [mm]     0.13   0.5   2     4.5   12.5  50
    sensor's sigma [mm]  1.2    1.9   6.1   14    41    176
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np
import zstandard
from numpy.typing import DTypeLike, NDArray

from surveilnav.contract import ID
from surveilnav.errors import WireError
from surveilnav.geometry import Pinhole
from surveilnav.messages import FrameHeader, PayloadPart
from surveilnav.sensing.scans import decode_scan
from surveilnav.sensing.views import PosedView

DEPTH_QUANTUM_PER_M: Final = 0.001

#: Limits for received data. A picture of 4096 x 4096 needs 48 MB as pixels and 64 MB as metric depth.
MAX_PIXELS: Final = 4096 * 4096
MAX_ARRAY_BYTES: Final = 256 * 1024 * 1024
MAX_EMBEDDING_DIM: Final = 4096
MAX_NAMES: Final = 4096  # classes of a vocabulary
MAX_LABEL_CHARS: Final = 100

_SOURCE = re.compile(rf"(robot|camera)/{ID}")
_BASELINE_JPEG = {
    0xC0,
    0xC1,
}  # progressive ones may have thousands of scans, which are cheap to write and costly to read
_STANDALONE = {0x01, *range(0xD0, 0xD9)}


# --- pictures -------------------------------------------------------------------------------------------------


def encode_rgbd(
    rgb: NDArray[np.uint8],
    depth_m: NDArray[np.floating],
    *,
    depth_range_m: tuple[float, float],
    jpeg_quality: int = 90,
) -> tuple[bytes, PayloadPart, PayloadPart]:
    """Encodes a registered RGB-D picture; returns the payload and its two parts.

    Args:
        rgb: (height, width, 3) uint8.
        depth_m: (height, width) [m] along the optical axis; values that aren't finite or in range are encoded as "none".
        depth_range_m: (nearest, farthest) depth, as in the header.
        jpeg_quality: 1-100.
    """
    image = encode_jpeg(rgb, jpeg_quality)
    depth = encode_depth(depth_m, depth_range_m)
    return image + depth, PayloadPart("jpeg", len(image)), PayloadPart("depth-invq-zstd", len(depth))


def decode_frame(header: FrameHeader, payload: bytes) -> PosedView:
    """Decodes the view in a frame or an observation.

    Raises:
        WireError: header and payload don't fit each other, or a value makes no sense.
    """
    if not _SOURCE.fullmatch(header.source):
        raise WireError(f"a source is 'robot/<id>' or 'camera/<id>', got {header.source[:80]!r}")
    if header.view < 0 or header.seq < 0:
        raise WireError(f"view and seq count from 0, got {header.view} and {header.seq}")
    if not (math.isfinite(header.mounting_offset_m) and abs(header.mounting_offset_m) < 100):
        raise WireError(f"the mounting offset must be a height in metres, got {header.mounting_offset_m}")
    uncertainty = header.depth_uncertainty
    if not (0.0 <= uncertainty.sigma <= 1.0 and 0.0 <= uncertainty.scale_sigma <= 1.0):
        raise WireError(f"a depth's uncertainty is given by standard deviations from 0 to 1, got {uncertainty}")
    if not all(math.isfinite(v) and abs(v) < 1e6 for v in header.T_world_camera.translation_m):
        raise WireError(f"the camera's position must be finite metres, got {header.T_world_camera.translation_m}")
    rgb, depth_m = decode_rgbd(payload, header.image, header.depth, header.camera, header.depth_range_m)
    return PosedView(
        source=header.source,
        view=header.view,
        seq=header.seq,
        stamp_ns=header.stamp_ns,
        floor=header.floor,
        T_world_camera=header.T_world_camera.matrix(),
        camera=header.camera,
        mounting_offset_m=header.mounting_offset_m,
        rgb=rgb,
        depth_m=depth_m,
        depth_range_m=header.depth_range_m,
        depth_source=header.depth_source,
        depth_uncertainty=uncertainty,
        scan=decode_scan(header.scan, header.T_world_camera.translation_m) if header.scan is not None else None,
    )


def decode_rgbd(
    payload: bytes, image: PayloadPart, depth: PayloadPart, camera: Pinhole, depth_range_m: tuple[float, float]
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Decodes a payload: rgb (height, width, 3) uint8, and depth (height, width) float32 [m], 0 where there is none.

    Raises:
        WireError: sizes, encodings or dimensions don't fit.
    """
    check_rgbd(payload, image, depth, camera)
    size = camera.width_px, camera.height_px
    return (
        decode_jpeg(payload[: image.n_bytes], *size),
        decode_depth(payload[image.n_bytes :], *size, depth_range_m),
    )


def check_rgbd(payload: bytes, image: PayloadPart, depth: PayloadPart, camera: Pinhole) -> None:
    """Checks all of a payload that can be checked before decoding a pixel: its parts, and the JPEG's dimensions.

    Raises:
        WireError: sizes, encodings or dimensions don't fit.
    """
    if image.encoding != "jpeg" or depth.encoding != "depth-invq-zstd":
        raise WireError(f"expected parts jpeg and depth-invq-zstd, got {image.encoding} and {depth.encoding}")
    if image.n_bytes <= 0 or depth.n_bytes <= 0 or image.n_bytes + depth.n_bytes != len(payload):
        raise WireError(
            f"the payload has {len(payload)} bytes, its header says {image.n_bytes} (image) + {depth.n_bytes} (depth)"
        )
    _check_jpeg(payload[: image.n_bytes], camera.width_px, camera.height_px)


def encode_jpeg(rgb: NDArray[np.uint8], quality: int = 90) -> bytes:
    """Encodes (height, width, 3) uint8 as baseline JPEG."""
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8:
        raise ValueError(f"a picture is (height, width, 3) uint8, got {rgb.shape} {rgb.dtype}")
    ok, data = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, int(quality)])
    if not ok:
        raise ValueError(f"OpenCV couldn't encode a picture of {rgb.shape}")
    return data.tobytes()


def decode_jpeg(data: bytes, width_px: int, height_px: int) -> NDArray[np.uint8]:
    """Decodes a baseline JPEG of these dimensions to RGB (height, width, 3) uint8.

    Raises:
        WireError: it isn't one, is cut off, or has other dimensions, which is checked before a pixel is decoded.
    """
    _check_jpeg(data, width_px, height_px)
    try:
        bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        raise WireError(f"the JPEG can't be decoded: {error.err}") from None
    if bgr is None or bgr.shape != (height_px, width_px, 3):
        raise WireError("the JPEG can't be decoded")
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def _check_jpeg(data: bytes, width_px: int, height_px: int) -> None:
    _check_pixels(width_px, height_px)
    size = _jpeg_size(data)
    if size != (width_px, height_px):
        raise WireError(f"the header says {width_px}x{height_px}, the JPEG {size[0]}x{size[1]}")
    if not data.endswith(b"\xff\xd9"):
        raise WireError("the JPEG is cut off: it doesn't end with its end marker")


def _jpeg_size(data: bytes) -> tuple[int, int]:
    """(width, height) in the frame header of a baseline JPEG with three components."""
    if not data.startswith(b"\xff\xd8"):
        raise WireError("the image isn't a JPEG: it doesn't begin with FF D8")
    at = 2
    while at + 4 <= len(data):
        if data[at] != 0xFF:
            break
        marker = data[at + 1]
        if marker == 0xFF or marker in _STANDALONE:
            at += 1 if marker == 0xFF else 2
            continue
        (length,) = struct.unpack_from(">H", data, at + 2)
        if marker in _BASELINE_JPEG and at + 10 <= len(data):
            _, height, width, components = struct.unpack_from(">BHHB", data, at + 4)
            if components != 3:
                raise WireError(f"the JPEG has {components} components, expected 3")
            return width, height
        if 0xC2 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            raise WireError(f"expected a baseline JPEG, got FF {marker:02X} (progressive, lossless or arithmetic)")
        if marker in (0xDA, 0xD9) or length < 2:
            break
        at += 2 + length
    raise WireError("the JPEG has no frame header")


def _check_pixels(width_px: int, height_px: int) -> None:
    if width_px < 1 or height_px < 1 or width_px * height_px > MAX_PIXELS:
        raise WireError(f"a picture may have up to {MAX_PIXELS} pixels, got {width_px}x{height_px}")


# --- depth ----------------------------------------------------------------------------------------------------


def encode_depth(depth_m: NDArray[np.floating], depth_range_m: tuple[float, float]) -> bytes:
    """Encodes depth (height, width) [m] as ``depth-invq-zstd``. Values that aren't finite or in range become "none"."""
    near, far = _checked_range(depth_range_m)
    depth = np.ascontiguousarray(depth_m, dtype=np.float32)
    if depth.ndim != 2:
        raise ValueError(f"a depth image is (height, width), got {depth.shape}")
    with np.errstate(invalid="ignore"):
        valid = (depth >= near) & (depth <= far)  # False for NaN
    steps = np.reciprocal(np.where(valid, depth, np.float32(1.0)))
    steps *= np.float32(1.0 / DEPTH_QUANTUM_PER_M)
    steps += np.float32(0.5)
    q = steps.astype(np.uint16)
    np.maximum(q, 1, out=q)
    q *= valid
    delta = q.copy()
    delta[:, 1:] -= q[:, :-1]
    delta[1:, 0] -= q[:-1, 0]
    signed = delta.view(np.int16)
    folded = ((signed << 1) ^ (signed >> 15)).view(np.uint16)
    return zstandard.ZstdCompressor(level=1).compress(to_byte_planes(folded))


def decode_depth(data: bytes, width_px: int, height_px: int, depth_range_m: tuple[float, float]) -> NDArray[np.float32]:
    """Decodes depth to (height, width) float32 [m], 0 where there is none; other values lie within ``depth_range_m``.

    Raises:
        WireError: the data isn't ``depth-invq-zstd`` of these dimensions, or the range is invalid.
    """
    _check_pixels(width_px, height_px)
    try:
        near, far = _checked_range(depth_range_m)
    except ValueError as error:
        raise WireError(str(error)) from None
    folded = from_byte_planes(_unzstd(data, 2 * width_px * height_px), (height_px, width_px))
    delta = (folded >> 1) ^ (-(folded & 1).view(np.int16)).view(np.uint16)
    delta[:, 0] = np.cumsum(delta[:, 0], dtype=np.uint16)
    steps = np.cumsum(delta, axis=1, dtype=np.uint16)
    return _depth_table(near, far).take(
        steps, mode="wrap"
    )  # the table has an entry for every step: no need to check them


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


def _depth_table(near_m: float, far_m: float) -> NDArray[np.float32]:
    """Depth of each step, (65536,) float32. Steps outside the range, by more than rounding, are "none"."""
    inverse_depth = np.arange(65536) * DEPTH_QUANTUM_PER_M
    inverse_depth[0] = np.inf  # none
    slack = 0.51 * DEPTH_QUANTUM_PER_M
    valid = (inverse_depth <= 1 / near_m + slack) & (inverse_depth >= 1 / far_m - slack)
    valid[1] |= 1 / far_m < 1.5 * DEPTH_QUANTUM_PER_M
    depth = np.clip(1.0 / inverse_depth, near_m, far_m)
    return np.where(valid, depth, 0.0).astype(np.float32)


def _checked_range(depth_range_m: tuple[float, float]) -> tuple[float, float]:
    near, far = (float(v) for v in depth_range_m)
    if not (0.02 <= near < far <= 1000.0):  # False for NaN
        raise ValueError(f"a depth range needs 0.02 m <= nearest < farthest <= 1000 m, got ({near}, {far})")
    return near, far


# --- embeddings ------------------------------------------------------------------------------------------------


def pack_embedding(embedding: NDArray[np.floating]) -> bytes:
    """Encodes a unit vector (D,) as little-endian float16."""
    vector = np.asarray(embedding)
    if vector.ndim != 1 or not 1 <= vector.size <= MAX_EMBEDDING_DIM:
        raise ValueError(f"an embedding is a vector of 1 to {MAX_EMBEDDING_DIM} numbers, got {vector.shape}")
    return vector.astype("<f2").tobytes()


def unpack_embedding(data: bytes, dim: int | None = None) -> NDArray[np.float32]:
    """Decodes and renormalises a unit vector (D,) float32. ``dim``: the expected D.

    Raises:
        WireError: its length is wrong, or it isn't finite, or far from unit length.
    """
    n = len(data) // 2
    if len(data) % 2 or not 1 <= n <= MAX_EMBEDDING_DIM or (dim is not None and n != dim):
        wanted = f"{dim}" if dim is not None else f"1 to {MAX_EMBEDDING_DIM}"
        raise WireError(f"an embedding has {wanted} float16 numbers, got {len(data)} bytes")
    vector = np.frombuffer(data, "<f2").astype(np.float32)
    norm = float(np.linalg.norm(vector))
    if not 0.9 <= norm <= 1.1:  # False for NaN; float16 of a unit vector stays far inside
        raise WireError(f"an embedding has unit length, got one of {norm:.3g}")
    return vector / np.float32(norm)


# --- arrays: map layers, truth ------------------------------------------------------------------------------------


def pack_array(array: NDArray, level: int = 1) -> bytes:
    """Encodes a row-major, little-endian array with zstd. Its dtype and shape must travel beside it."""
    little = np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<"), copy=False)
    return zstandard.ZstdCompressor(level=level).compress(little.tobytes())


def unpack_array(data: bytes, dtype: DTypeLike, shape: Sequence[int], max_bytes: int = MAX_ARRAY_BYTES) -> NDArray:
    """Decodes a (read-only) array of this dtype and shape.

    Raises:
        WireError: the bytes don't fit dtype and shape, or the array would take more than ``max_bytes``.
    """
    kind = np.dtype(dtype).newbyteorder("<")
    if any(int(n) < 0 for n in shape) or len(shape) > 8:
        raise WireError(f"a shape has up to 8 sizes from 0 up, got {tuple(shape)[:9]}")
    n_bytes = math.prod(int(n) for n in shape) * kind.itemsize
    if n_bytes > max_bytes:
        raise WireError(f"an array may have up to {max_bytes} bytes, its header says {n_bytes}")
    return np.frombuffer(_unzstd(data, n_bytes), kind).reshape(tuple(int(n) for n in shape))


def _unzstd(data: bytes, n_bytes: int) -> bytes:
    """Decompresses one zstd frame of ``n_bytes``. The stated size is checked before anything is allocated."""
    try:
        stated = zstandard.frame_content_size(data)
        if stated != n_bytes:
            raise WireError(f"expected zstd data of {n_bytes} bytes, it says it holds {stated}")
        raw: bytes = zstandard.ZstdDecompressor().decompress(data, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise WireError(f"the data can't be decompressed: {error}") from None
    if len(raw) != n_bytes:
        raise WireError(f"expected {n_bytes} bytes, got {len(raw)}")
    return raw
