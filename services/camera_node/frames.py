"""A camera's views as bytes: each version is encoded once, however often it is put, and a simulated one in all runs once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import msgspec

from surveilnav.messages import Part
from surveilnav.sensing.packing import encode_jpeg, encode_rgbd
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.kept import Kept
from surveilnav.services.camera_node.sources.source import Source

_THUMBNAIL_QUALITY = 80


@dataclass(frozen=True, slots=True)
class Encoded:
    """One version of a view as a payload and its parts."""

    version: int
    payload: bytes
    image: Part
    depth: Part


class EncodedViews:
    """The views of one source, encoded when they are wanted."""

    def __init__(self, source: Source, settings: CameraSettings) -> None:
        self._source, self._jpeg_quality, self._kept = source, settings.jpeg_quality, Kept(source, settings)
        self._how = f"frame, JPEG {settings.jpeg_quality}"
        self._newest: dict[int, Encoded] = {}

    def newest(self, view: int) -> Encoded:
        """The latest picture of a view that has one, encoded unless it was before."""
        known, version = self._newest.get(view), self._source.version(view)
        if known is None or known.version != version:
            key = self._kept.key_of(view, self._how)
            before = self._kept.get(key, lambda parts: _of_parts(version or 0, parts))
            known = self._newest[view] = before or self._encoded(view, key)
        return known

    def _encoded(self, view: int, key: str) -> Encoded:
        picture = self._source.latest(view)
        payload, image, depth = encode_rgbd(
            picture.rgb, picture.depth_m, depth_range_m=self._source.depth_range_m, jpeg_quality=self._jpeg_quality
        )
        self._kept.put(key, view, self._how, [payload, msgspec.msgpack.encode((image, depth))])
        return Encoded(picture.version, payload, image, depth)

    def thumbnail(self, view: int, width_px: int) -> bytes:
        """A small JPEG of a view that has a picture, at its own aspect ratio."""
        rgb = self._source.latest(view).rgb
        height_px = round(width_px * rgb.shape[0] / rgb.shape[1])
        return encode_jpeg(cv2.resize(rgb, (width_px, height_px), interpolation=cv2.INTER_AREA), _THUMBNAIL_QUALITY)


def _of_parts(version: int, parts: Sequence[bytes]) -> Encoded:
    """What another run encoded of the same view."""
    image, depth = msgspec.msgpack.decode(parts[1], type=tuple[Part, Part])
    return Encoded(version, parts[0], image, depth)
