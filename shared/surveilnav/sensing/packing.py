"""Encodes pictures, depth, embeddings and arrays as bytes, and decodes them.

Data from the network may be malicious: sizes are checked before anything is decompressed, and any fault raises ``WireError``.
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
from surveilnav.messages import PERCEIVED_TIERS, FrameHeader, PayloadPart
from surveilnav.sensing.depth_codec import decode_depth, encode_depth
from surveilnav.sensing.limits import MAX_ARRAY_BYTES, check_pixels, unzstd
from surveilnav.sensing.scans import decode_scan
from surveilnav.sensing.views import PosedView

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
    rest = header.perceived.n_bytes if header.perceived is not None else 0
    if not 0 <= rest <= len(payload):
        raise WireError(
            f"the payload has {len(payload)} bytes, its header says that {rest} of them are what was perceived"
        )
    rgbd, is_reduced = payload[: len(payload) - rest], header.tier in PERCEIVED_TIERS
    rgb, depth_m = decode_rgbd(
        rgbd, header.image, header.depth, header.camera, header.depth_range_m, is_reduced=is_reduced
    )
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


def picture_jpeg(header: FrameHeader, payload: bytes) -> bytes:
    """The picture of a frame as a JPEG of the view's size, for people: an enlarged one if a smaller one was sent.

    Raises:
        WireError: it can't be decoded.
    """
    data = bytes(payload[: header.image.n_bytes])
    if header.image.encoding == "jpeg" and header.tier not in PERCEIVED_TIERS:
        return data
    check_pixels(header.camera.width_px, header.camera.height_px)
    rgb = _decoded_picture(header.image, data, _picture_size(header.image, data))
    return encode_jpeg(_enlarged(rgb, header.camera))


def _picture_size(image: PayloadPart, data: bytes) -> tuple[int, int]:
    """(width, height) that a JPEG or PNG says it has."""
    return _png_size(data) if image.encoding == "png" else _jpeg_size(data)


def _decoded_picture(image: PayloadPart, data: bytes, size_px: tuple[int, int]) -> NDArray[np.uint8]:
    return decode_png(data, *size_px) if image.encoding == "png" else decode_jpeg(data, *size_px)


def _enlarged(rgb: NDArray[np.uint8], camera: Pinhole) -> NDArray[np.uint8]:
    size = camera.width_px, camera.height_px
    return (
        rgb if rgb.shape[1::-1] == size else np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_LINEAR), np.uint8)
    )


def decode_rgbd(
    payload: bytes,
    image: PayloadPart,
    depth: PayloadPart,
    camera: Pinhole,
    depth_range_m: tuple[float, float],
    *,
    is_reduced: bool = False,
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Decodes a payload: rgb (height, width, 3) uint8, and depth (height, width) float32 [m], 0 where there is none.

    ``is_reduced``: the picture may be smaller than the view, and is enlarged.

    Raises:
        WireError: sizes, encodings or dimensions don't fit.
    """
    size_px = check_rgbd(payload, image, depth, camera, is_reduced=is_reduced)
    rgb = _decoded_picture(image, payload[: image.n_bytes], size_px)
    return _enlarged(rgb, camera), decode_depth(
        payload[image.n_bytes :],
        camera.width_px,
        camera.height_px,
        depth_range_m,
        divisor=depth.divisor,
        quantum_per_m=depth.quantum_per_m,
    )


def check_rgbd(
    payload: bytes, image: PayloadPart, depth: PayloadPart, camera: Pinhole, *, is_reduced: bool = False
) -> tuple[int, int]:
    """Checks all of a payload that can be checked before decoding a pixel. Returns (width, height) of its picture.

    Raises:
        WireError: sizes, encodings or dimensions don't fit.
    """
    if image.encoding not in ("jpeg", "png") or depth.encoding != "depth-invq-zstd":
        raise WireError(f"expected parts jpeg or png and depth-invq-zstd, got {image.encoding} and {depth.encoding}")
    if image.n_bytes <= 0 or depth.n_bytes <= 0 or image.n_bytes + depth.n_bytes != len(payload):
        raise WireError(
            f"the payload has {len(payload)} bytes, its header says {image.n_bytes} (image) + {depth.n_bytes} (depth)"
        )
    check_pixels(camera.width_px, camera.height_px)
    width_px, height_px = _picture_size(image, payload[: image.n_bytes])
    fits = width_px <= camera.width_px and height_px <= camera.height_px
    if not (fits if is_reduced else (width_px, height_px) == (camera.width_px, camera.height_px)):
        kind = image.encoding.upper()
        raise WireError(f"the header says {camera.width_px}x{camera.height_px}, the {kind} {width_px}x{height_px}")
    return width_px, height_px


def encode_png(rgb: NDArray[np.uint8]) -> bytes:
    """Encodes (height, width, 3) uint8 as PNG, which loses nothing."""
    return _encoded(".png", rgb, [cv2.IMWRITE_PNG_COMPRESSION, 3])


def decode_png(data: bytes, width_px: int, height_px: int) -> NDArray[np.uint8]:
    """Decodes a PNG of these dimensions, of three channels of 8 bits, to RGB (height, width, 3) uint8.

    Raises:
        WireError: it isn't one, is cut off, or has other dimensions, which is checked before a pixel is decoded.
    """
    check_pixels(width_px, height_px)
    if (size := _png_size(data)) != (width_px, height_px):
        raise WireError(f"the header says {width_px}x{height_px}, the PNG {size[0]}x{size[1]}")
    return _decoded(data, width_px, height_px, "PNG")


def _png_size(data: bytes) -> tuple[int, int]:
    """(width, height) in the header of a PNG of three channels of 8 bits."""
    if len(data) < 33 or data[:8] != b"\x89PNG\r\n\x1a\n" or data[12:16] != b"IHDR":
        raise WireError("the image isn't a PNG: it doesn't begin with its signature and IHDR")
    width, height, depth, colours = struct.unpack_from(">IIBB", data, 16)
    if (depth, colours) != (8, 2):
        raise WireError(f"expected a PNG of three channels of 8 bits, got {depth} bits and colour type {colours}")
    if not data.endswith(b"IEND\xaeB`\x82"):
        raise WireError("the PNG is cut off: it doesn't end with its end marker")
    return width, height


def encode_jpeg(rgb: NDArray[np.uint8], quality: int = 90) -> bytes:
    """Encodes (height, width, 3) uint8 as baseline JPEG."""
    return _encoded(".jpg", rgb, [cv2.IMWRITE_JPEG_QUALITY, int(quality)])


def _encoded(suffix: str, rgb: NDArray[np.uint8], options: list[int]) -> bytes:
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8:
        raise ValueError(f"a picture is (height, width, 3) uint8, got {rgb.shape} {rgb.dtype}")
    ok, data = cv2.imencode(suffix, cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), options)
    if not ok:
        raise ValueError(f"OpenCV couldn't encode a picture of {rgb.shape}")
    return data.tobytes()


def decode_jpeg(data: bytes, width_px: int, height_px: int) -> NDArray[np.uint8]:
    """Decodes a baseline JPEG of these dimensions to RGB (height, width, 3) uint8.

    Raises:
        WireError: it isn't one, is cut off, or has other dimensions, which is checked before a pixel is decoded.
    """
    _check_jpeg(data, width_px, height_px)
    return _decoded(data, width_px, height_px, "JPEG")


def _decoded(data: bytes, width_px: int, height_px: int, kind: str) -> NDArray[np.uint8]:
    try:
        bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        raise WireError(f"the {kind} can't be decoded: {error.err}") from None
    if bgr is None or bgr.shape != (height_px, width_px, 3):
        raise WireError(f"the {kind} can't be decoded")
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def _check_jpeg(data: bytes, width_px: int, height_px: int) -> None:
    check_pixels(width_px, height_px)
    size = _jpeg_size(data)
    if size != (width_px, height_px):
        raise WireError(f"the header says {width_px}x{height_px}, the JPEG {size[0]}x{size[1]}")


def _jpeg_size(data: bytes) -> tuple[int, int]:
    """(width, height) in the frame header of a whole baseline JPEG with three components."""
    if not data.startswith(b"\xff\xd8"):
        raise WireError("the image isn't a JPEG: it doesn't begin with FF D8")
    if not data.endswith(b"\xff\xd9"):
        raise WireError("the JPEG is cut off: it doesn't end with its end marker")
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
    return np.frombuffer(unzstd(data, n_bytes), kind).reshape(tuple(int(n) for n in shape))
