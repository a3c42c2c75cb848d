"""Encodes a camera's views: each version once, however often it is sent, and a simulated view once for all runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import msgspec

from surveilnav.messages import MEASURED, CaptureClock, DepthSource, DepthUncertainty, PayloadPart
from surveilnav.sensing.packing import encode_jpeg, encode_rgbd
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.core.sending import thumbnail_width_px
from surveilnav.services.camera_node.result_cache import ResultCache
from surveilnav.services.camera_node.sources.source import Source

_THUMBNAIL_QUALITY = 80


@dataclass(frozen=True, slots=True)
class EncodedFrame:
    """One version of a view: ``payload`` is the encoded colour, then depth, as ``image`` and ``depth`` describe them.

    ``captured_ns``, ``clock``, ``depth_source`` and ``depth_uncertainty`` are those of its ``Picture``.
    """

    version: int
    payload: bytes
    image: PayloadPart
    depth: PayloadPart
    captured_ns: int = 0
    clock: CaptureClock = "arrival"
    depth_source: DepthSource = "sensor"
    depth_uncertainty: DepthUncertainty = MEASURED


class FrameEncoder:
    """Encodes the views of one source on demand."""

    def __init__(self, source: Source, settings: CameraSettings) -> None:
        self._source, self._jpeg_quality = source, settings.jpeg_quality
        self._max_thumbnail_px = settings.thumbnail_width_px
        self._cache, self._recipe = ResultCache(source, settings), f"frame, JPEG {settings.jpeg_quality}"
        self._frames: dict[int, EncodedFrame] = {}

    def newest(self, view: int) -> EncodedFrame:
        """The latest picture of a view that has one; encoded only if neither this nor an earlier run did so."""
        frame, version = self._frames.get(view), self._source.version(view)
        if frame is None or frame.version != version:
            key = self._cache.key_for(view, self._recipe)
            cached = self._cache.get(key, lambda parts: _parse_frame(version or 0, parts))
            frame = self._frames[view] = cached or self._encode(view, key)
        return frame

    def _encode(self, view: int, cache_key: str) -> EncodedFrame:
        picture = self._source.latest(view)
        payload, image, depth = encode_rgbd(
            picture.rgb, picture.depth_m, depth_range_m=self._source.depth_range_m, jpeg_quality=self._jpeg_quality
        )
        self._cache.put(cache_key, view, self._recipe, [payload, msgspec.msgpack.encode((image, depth))])
        return EncodedFrame(
            picture.version,
            payload,
            image,
            depth,
            picture.captured_ns,
            picture.clock,
            picture.depth_source,
            picture.depth_uncertainty,
        )

    def thumbnail(self, view: int, requested_px: int) -> bytes:
        """A JPEG of the given width of a view that has a picture, in the picture's aspect ratio."""
        width_px, rgb = thumbnail_width_px(requested_px, self._max_thumbnail_px), self._source.latest(view).rgb
        height_px = round(width_px * rgb.shape[0] / rgb.shape[1])
        return encode_jpeg(cv2.resize(rgb, (width_px, height_px), interpolation=cv2.INTER_AREA), _THUMBNAIL_QUALITY)


def _parse_frame(version: int, parts: Sequence[bytes]) -> EncodedFrame:
    image, depth = msgspec.msgpack.decode(parts[1], type=tuple[PayloadPart, PayloadPart])
    return EncodedFrame(version, parts[0], image, depth)
