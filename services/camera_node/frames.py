"""A camera's views as bytes: each version is encoded once, however often it is put."""

from __future__ import annotations

from dataclasses import dataclass

import cv2

from services.camera_node.sources.source import Source
from surveilnav.messages import Part
from surveilnav.sensing.packing import encode_jpeg, encode_rgbd

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

    def __init__(self, source: Source, jpeg_quality: int) -> None:
        self._source, self._jpeg_quality = source, jpeg_quality
        self._newest: dict[int, Encoded] = {}

    def newest(self, view: int) -> Encoded:
        """The latest picture of a view that has one, encoded unless it was before."""
        known = self._newest.get(view)
        if known is None or known.version != self._source.version(view):
            picture = self._source.latest(view)
            payload, image, depth = encode_rgbd(
                picture.rgb, picture.depth_m, depth_range_m=self._source.depth_range_m, jpeg_quality=self._jpeg_quality
            )
            known = self._newest[view] = Encoded(picture.version, payload, image, depth)
        return known

    def thumbnail(self, view: int, width_px: int) -> bytes:
        """A small JPEG of a view that has a picture, at its own aspect ratio."""
        rgb = self._source.latest(view).rgb
        height_px = round(width_px * rgb.shape[0] / rgb.shape[1])
        return encode_jpeg(cv2.resize(rgb, (width_px, height_px), interpolation=cv2.INTER_AREA), _THUMBNAIL_QUALITY)
