"""Encodes a camera's views: each version once, however often it is sent, and a simulated view once for all runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import msgspec

from surveilnav.errors import PerceptionError
from surveilnav.messages import (
    MEASURED,
    PERCEIVED_TIERS,
    CaptureClock,
    DepthSource,
    DepthUncertainty,
    PayloadPart,
    Tier,
)
from surveilnav.perception import models
from surveilnav.perception.names import BackendName
from surveilnav.sensing.packing import encode_jpeg
from surveilnav.sensing.tiers import encode_view
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.core.sending import thumbnail_width_px
from surveilnav.services.camera_node.own_perception import OwnPerception
from surveilnav.services.camera_node.result_cache import ResultCache
from surveilnav.services.camera_node.sources.source import Source

_THUMBNAIL_QUALITY = 80


@dataclass(frozen=True, slots=True)
class EncodedFrame:
    """One version of a view in a tier: ``payload`` consists of ``image``, ``depth`` and ``perceived``.

    ``captured_ns``, ``clock``, ``depth_source`` and ``depth_uncertainty`` are those of its ``Picture``.
    """

    version: int
    payload: bytes
    image: PayloadPart
    depth: PayloadPart
    tier: Tier = "jpeg+depth"
    perceived: PayloadPart | None = None
    captured_ns: int = 0
    clock: CaptureClock = "arrival"
    depth_source: DepthSource = "sensor"
    depth_uncertainty: DepthUncertainty = MEASURED


class FrameEncoder:
    """Encodes the views of one source on demand."""

    def __init__(self, source: Source, settings: CameraSettings, own: OwnPerception | None = None) -> None:
        """``own``: the camera's own perception, for tiers that need it."""
        self._source, self._own, self._jpeg_quality = source, own, settings.jpeg_quality
        self._max_thumbnail_px = settings.thumbnail_width_px
        self._cache, self._looks_by = ResultCache(source, settings), settings.perception
        self._frames: dict[int, EncodedFrame] = {}

    def newest(self, view: int, tier: Tier = "jpeg+depth") -> EncodedFrame:
        """The latest picture of a view that has one; encoded only if neither this nor an earlier run did so.

        Raises:
            PerceptionError: the tier needs what the camera's own perception sees, and that failed.
        """
        frame, version = self._frames.get(view), self._source.version(view)
        if frame is None or (frame.version, frame.tier) != (version, tier):
            recipe = self._recipe(tier)
            key = self._cache.key_for(view, recipe) if recipe else ""
            cached = self._cache.get(key, lambda parts: _parse_frame(version or 0, tier, parts))
            frame = self._frames[view] = cached or self._encode(view, tier, key, recipe)
        return frame

    def _recipe(self, tier: Tier) -> str:
        """All that a frame depends on besides the view's content; empty if that can't be said."""
        if tier not in PERCEIVED_TIERS:
            return f"frame, {tier}, JPEG {self._jpeg_quality}"
        if BackendName(self._looks_by).is_told:
            return ""
        return f"frame, {tier}, seen by {self._looks_by} with {models.small_weights()}"

    def _encode(self, view: int, tier: Tier, cache_key: str, recipe: str) -> EncodedFrame:
        picture = self._source.latest(view)
        if tier in PERCEIVED_TIERS and self._own is None:
            raise PerceptionError(f"the tier {tier} needs the camera's own perception, and it has none")
        seen = self._own.see(view, picture) if self._own is not None and tier in PERCEIVED_TIERS else None
        encoded = encode_view(
            tier,
            picture.rgb,
            picture.depth_m,
            self._source.intrinsics,
            depth_range_m=self._source.depth_range_m,
            jpeg_quality=self._jpeg_quality,
            seen=seen,
        )
        parts = _Parts(encoded.image, encoded.depth, encoded.perceived, encoded.has_depth)
        self._cache.put(cache_key, view, recipe, [encoded.payload, msgspec.msgpack.encode(parts)])
        return EncodedFrame(
            picture.version,
            encoded.payload,
            encoded.image,
            encoded.depth,
            tier,
            encoded.perceived,
            picture.captured_ns,
            picture.clock,
            picture.depth_source if encoded.has_depth else "none",
            picture.depth_uncertainty if encoded.has_depth else MEASURED,
        )

    def thumbnail(self, view: int, requested_px: int) -> bytes:
        """A JPEG of the given width of a view that has a picture, in the picture's aspect ratio."""
        width_px, rgb = thumbnail_width_px(requested_px, self._max_thumbnail_px), self._source.latest(view).rgb
        height_px = round(width_px * rgb.shape[0] / rgb.shape[1])
        return encode_jpeg(cv2.resize(rgb, (width_px, height_px), interpolation=cv2.INTER_AREA), _THUMBNAIL_QUALITY)


class _Parts(msgspec.Struct, frozen=True, array_like=True):
    """What is stored of a frame besides its payload."""

    image: PayloadPart
    depth: PayloadPart
    perceived: PayloadPart | None
    has_depth: bool


def _parse_frame(version: int, tier: Tier, stored: Sequence[bytes]) -> EncodedFrame:
    parts = msgspec.msgpack.decode(stored[1], type=_Parts)
    source: DepthSource = "sensor" if parts.has_depth else "none"
    return EncodedFrame(version, stored[0], parts.image, parts.depth, tier, parts.perceived, depth_source=source)
