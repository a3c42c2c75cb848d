"""The robot's camera: colour and depth pictures as ROS sends them, decoded, undistorted, and paired by their time stamps."""

from __future__ import annotations

import math
import threading
from collections import deque
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import SurveilNavError
from surveilnav.geometry import Pinhole
from surveilnav.geometry.lens import BrownConrady, KannalaBrandt, Lens, Undistortion

#: Colour and depth belong together if their stamps differ by less.
_PAIR_NS = 50_000_000
_KEPT = 6
_CONFIG_HEADER_BYTES = 12  # of compressed_depth_image_transport
_CHANNELS = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "mono8": 1}
_TO_RGB = {
    "bgr8": cv2.COLOR_BGR2RGB,
    "rgba8": cv2.COLOR_RGBA2RGB,
    "bgra8": cv2.COLOR_BGRA2RGB,
    "mono8": cv2.COLOR_GRAY2RGB,
}
#: A median depth of metres beyond this, or of millimetres below, means that the unit isn't the encoding's.
_FARTHEST_M, _NEAREST_M = 100.0, 0.03


class PictureError(SurveilNavError):
    """A picture can't be used. The message says what was expected and what came, for people."""


@dataclass(frozen=True, slots=True, eq=False)
class PicturePair:
    """Colour and depth of one moment, undistorted.

    Attributes:
        stamp_ns: time of capture by the robot's clock.
        frame: the camera's optical frame (x right, y down, z forward).
        rgb: (height, width, 3) uint8. depth_m: (height, width) float32, 0 where there is none.
    """

    stamp_ns: int
    frame: str
    camera: Pinhole
    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]


def stamp_of(header: Any) -> int:
    """The time stamp of a ROS header in nanoseconds."""
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def decode_colour(message: Any) -> NDArray[np.uint8]:
    """(height, width, 3) uint8 of a sensor_msgs Image or CompressedImage. Raises PictureError."""
    if hasattr(message, "format"):
        picture = cv2.imdecode(np.asarray(message.data), cv2.IMREAD_COLOR)
        if picture is None:
            raise PictureError(
                f"expected a JPEG or PNG, got {len(message.data)} bytes of format {message.format!r:.60}"
            )
        return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8)
    channels = _CHANNELS.get(message.encoding)
    if channels is None:
        raise PictureError(f"expected colour as {', '.join(_CHANNELS)}, got encoding {message.encoding!r:.60}")
    pixels = _rows(message, np.dtype(np.uint8), channels)
    if message.encoding == "rgb8":
        return np.ascontiguousarray(pixels)
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(pixels), _TO_RGB[message.encoding]), np.uint8)


def decode_depth(message: Any) -> NDArray[np.float32]:
    """(height, width) float32 [m] of a depth Image or a CompressedImage of compressedDepth; 0: none. Raises PictureError."""
    depth_m = _compressed_depth(message) if hasattr(message, "format") else _raw_depth(message)
    depth_m = np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, 0.0).astype(np.float32)
    measured = depth_m[depth_m > 0]
    if len(measured):
        median_m = float(np.median(measured))
        if not _NEAREST_M <= median_m <= _FARTHEST_M:
            kind = getattr(message, "encoding", "") or getattr(message, "format", "")
            raise PictureError(
                f"depth of encoding {kind!r:.60} has a median of {median_m:.4g} m: its driver mistakes metres and millimetres "
                "(16UC1 holds millimetres, 32FC1 metres)"
            )
    return depth_m


def _raw_depth(message: Any) -> NDArray[np.float32]:
    order = ">" if message.is_bigendian else "<"
    if message.encoding in ("16UC1", "mono16"):
        return _rows(message, np.dtype(f"{order}u2"), 1).astype(np.float32) / 1000.0
    if message.encoding == "32FC1":
        return _rows(message, np.dtype(f"{order}f4"), 1).astype(np.float32)
    raise PictureError(f"expected depth as 16UC1 (mm) or 32FC1 (m), got encoding {message.encoding!r:.60}")


def _compressed_depth(message: Any) -> NDArray[np.float32]:
    """Source: compressed_depth_image_transport of ros-perception/image_transport_plugins: a header of a format and two numbers a
    and b, then a PNG of 16 bits, which holds millimetres for 16UC1 and a / depth + b for 32FC1."""
    data = bytes(message.data)
    png = cv2.imdecode(np.frombuffer(data[_CONFIG_HEADER_BYTES:], np.uint8), cv2.IMREAD_UNCHANGED)
    if png is None or png.dtype != np.uint16 or png.ndim != 2:
        raise PictureError(
            f"expected compressedDepth, a PNG of 16 bits, got {len(data)} bytes of {message.format!r:.60}"
        )
    if "32FC1" not in message.format:
        return np.asarray(png.astype(np.float32) / 1000.0)
    a, b = np.frombuffer(data[4:_CONFIG_HEADER_BYTES], "<f4")
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(png > 0, a / (png.astype(np.float32) - b), 0.0), np.float32)


def _rows(message: Any, dtype: np.dtype, channels: int) -> NDArray:
    """The pixels (height, width[, channels]) of a raw image, whose rows may be padded."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    row_bytes = width * channels * dtype.itemsize
    data = np.asarray(message.data, np.uint8)
    if not (0 < height <= 16384 and 0 < width <= 16384 and row_bytes <= step and len(data) >= step * height):
        raise PictureError(
            f"expected {height} rows of {step} bytes with {width} pixels of {message.encoding}, got {len(data)} bytes"
        )
    rows = np.ascontiguousarray(data[: step * height].reshape(height, step)[:, :row_bytes])
    pixels = rows.view(dtype).reshape(height, width, channels)
    return pixels if channels > 1 else pixels[..., 0]


def lens_of(info: Any) -> Lens:
    """The lens of a CameraInfo. Raises PictureError."""
    k, d = [float(v) for v in info.k], [float(v) for v in info.d]
    if not any(d):
        d = []
    try:
        pinhole = Pinhole(int(info.width), int(info.height), k[0], k[4], k[2], k[5])
        if info.distortion_model in ("", "plumb_bob", "rational_polynomial"):
            return BrownConrady(pinhole, tuple(d))
        if info.distortion_model in ("equidistant", "fisheye"):
            return KannalaBrandt(pinhole, tuple(d))
    except ValueError as error:
        raise PictureError(f"camera_info can't be used: {error}") from None
    raise PictureError(f"camera_info has the unknown distortion model {info.distortion_model!r:.60}")


class RobotCamera:
    """Keeps the newest pictures and pairs them. Thread-safe: messages arrive on Zenoh's threads.

    Attributes:
        problem: why the last picture couldn't be used; empty if it could.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._colour: deque[tuple[int, Any]] = deque(maxlen=_KEPT)
        self._depth: deque[tuple[int, Any]] = deque(maxlen=_KEPT)
        self._info: Any = None
        self._undistortion: tuple[Any, Undistortion] | None = None
        self.problem = ""

    def add_colour(self, message: Any) -> None:
        with self._lock:
            self._colour.append((stamp_of(message.header), message))

    def add_depth(self, message: Any) -> None:
        with self._lock:
            self._depth.append((stamp_of(message.header), message))

    def set_info(self, message: Any) -> None:
        with self._lock:
            self._info = message

    @property
    def hfov_rad(self) -> float | None:
        """Its horizontal field of view; None: no camera_info came yet."""
        with self._lock:
            info = self._info
        try:
            return None if info is None else lens_of(info).hfov_rad
        except PictureError:
            return None

    @property
    def frame(self) -> str:
        """The optical frame of the newest picture; empty: none came yet."""
        with self._lock:
            return str(self._colour[-1][1].header.frame_id) if self._colour else ""

    def missing(self) -> str:
        """Which of its topics is silent, for people; empty if none is, or a pair can't be told for another reason."""
        with self._lock:
            names = {"colour pictures": self._colour, "depth pictures": self._depth, "camera_info": self._info}
            silent = [name for name, value in names.items() if not value]
            if silent:
                return f"no {' and no '.join(silent)} came yet"
            gap_s = min(abs(c - d) for c, _ in self._colour for d, _ in self._depth) / 1e9
        return f"colour and depth are never nearer in time than {gap_s:.2f} s" if gap_s * 1e9 > _PAIR_NS else ""

    def stamps(self) -> list[int]:
        """The times of all pairs, newest first."""
        with self._lock:
            return [stamp for stamp, _ in reversed(self._colour) if self._partner(stamp) is not None]

    def pair(self, stamp_ns: int) -> PicturePair | None:
        """The pair of a moment, decoded; None: it is gone, or it can't be used (``problem`` says why)."""
        with self._lock:
            colour = next((m for t, m in self._colour if t == stamp_ns), None)
            depth, info = self._partner(stamp_ns), self._info
        if colour is None or depth is None or info is None:
            return None
        try:
            pair = self._decode(stamp_ns, colour, depth, info)
        except PictureError as error:
            self.problem = str(error)
            return None
        self.problem = ""
        return pair

    def _partner(self, stamp_ns: int) -> Any:
        nearest = min(self._depth, key=lambda entry: abs(entry[0] - stamp_ns), default=None)
        return nearest[1] if nearest is not None and abs(nearest[0] - stamp_ns) <= _PAIR_NS else None

    def _decode(self, stamp_ns: int, colour: Any, depth: Any, info: Any) -> PicturePair:
        rgb, depth_m, lens = decode_colour(colour), decode_depth(depth), lens_of(info)
        height, width = rgb.shape[:2]
        if (width, height) != (lens.pinhole.width_px, lens.pinhole.height_px):
            raise PictureError(
                f"camera_info is of {lens.pinhole.width_px}x{lens.pinhole.height_px} pixels, the picture has {width}x{height}"
            )
        if depth_m.shape != (height, width):
            if not math.isclose(depth_m.shape[1] / depth_m.shape[0], width / height, rel_tol=0.02):
                raise PictureError(
                    f"depth has {depth_m.shape[1]}x{depth_m.shape[0]} pixels: is it registered to colour?"
                )
            depth_m = cv2.resize(depth_m, (width, height), interpolation=cv2.INTER_NEAREST)
        if lens.distortion:
            undistortion = self._undistortion_of(info, lens)
            rgb = undistortion.picture(rgb)
            maps = undistortion.map_px
            if undistortion.shrink == 1:
                depth_m = np.asarray(cv2.remap(depth_m, maps, None, cv2.INTER_NEAREST, borderValue=0.0))
                depth_m[~undistortion.seen] = 0.0
        return PicturePair(stamp_ns, str(colour.header.frame_id), lens.pinhole, rgb, np.asarray(depth_m, np.float32))

    def _undistortion_of(self, info: Any, lens: Lens) -> Undistortion:
        facts = info.width, info.height, tuple(info.k), tuple(info.d), info.distortion_model
        if self._undistortion is None or self._undistortion[0] != facts:
            self._undistortion = facts, Undistortion.from_lens(lens, lens.pinhole)
        return self._undistortion[1]
