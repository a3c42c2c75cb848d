"""A source whose mask zones are painted over before anybody gets a picture: the camera itself doesn't see them."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.sources.source import Picture, Source
from surveilnav.services.camera_node.zones import Zones, masked_pixels, read_zones


def masked(source: Source, settings: CameraSettings) -> Source:
    """``source`` without what the settings' file of zones names; itself where that is nothing.

    Raises:
        ConfigError: the file can't be read or believed: then the camera must show nothing at all.
    """
    if not settings.masks:
        return source
    zones = read_zones(Path(settings.masks), source.place.name, len(source.views))
    return MaskedSource(source, zones) if zones else source


class MaskedSource:
    """A ``Source``: colour, depth and truth inside the zones are gone. What is there isn't free, it is unknown."""

    def __init__(self, source: Source, zones: Zones) -> None:
        self._source, self.zones = source, zones
        self.place, self.views = source.place, source.views
        self.intrinsics, self.depth_range_m = source.intrinsics, source.depth_range_m
        self._pixels: dict[tuple[int, int, int], NDArray[np.bool_]] = {}

    def version(self, view: int) -> int | None:
        """The source's own."""
        return self._source.version(view)

    def content(self, view: int) -> str:
        """The source's own, and the view's zones."""
        content = self._source.content(view)
        if not content or view not in self.zones:
            return content
        return hashlib.sha256(repr((content, self.zones[view])).encode()).hexdigest()

    def latest(self, view: int) -> Picture:
        """The picture with its zones black, without depth, without instances."""
        picture = self._source.latest(view)
        if view not in self.zones:
            return picture
        hidden = self._hidden(view, *picture.rgb.shape[:2])
        truth = picture.truth
        return replace(
            picture,
            rgb=np.where(hidden[..., None], np.uint8(0), picture.rgb),
            depth_m=np.where(hidden, np.float32(0.0), picture.depth_m),
            truth=None if truth is None else replace(truth, ids=np.where(hidden, np.uint16(0), truth.ids)),
        )

    def _hidden(self, view: int, height_px: int, width_px: int) -> NDArray[np.bool_]:
        key = view, height_px, width_px
        if key not in self._pixels:
            self._pixels[key] = masked_pixels(self.zones[view], width_px, height_px)
        return self._pixels[key]
