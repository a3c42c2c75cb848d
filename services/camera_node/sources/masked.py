"""Hides the mask zones of a source before anything else gets its pictures, the camera's own detector included."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry.polygon import pixels_in
from surveilnav.messages import StreamStatus
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.sources.source import Picture, Source
from surveilnav.services.camera_node.zones import Zones, read_zones


def hide_mask_zones(source: Source, settings: CameraSettings) -> Source:
    """``source`` without the zones that ``settings.masks`` lists for it; ``source`` itself if there are none.

    Raises:
        ConfigError: the file can't be read or is ambiguous. The camera must not start then.
    """
    if not settings.masks:
        return source
    zones = read_zones(Path(settings.masks), source.place.name, len(source.views))
    return MaskedSource(source, zones) if zones else source


class MaskedSource:
    """A ``Source`` without colour, depth and truth inside its zones. Maps treat these pixels as unknown, not as free."""

    def __init__(self, source: Source, zones: Zones) -> None:
        self._source, self.zones = source, zones
        self.place, self.views = source.place, source.views
        self.intrinsics, self.depth_range_m = source.intrinsics, source.depth_range_m
        self.has_depth = source.has_depth
        self._masks: dict[tuple[int, int, int], NDArray[np.bool_]] = {}

    @property
    def stream(self) -> StreamStatus:
        """What the source's stream is doing."""
        return self._source.stream

    def version(self, view: int) -> int | None:
        """The version of the unmasked picture: zones don't change while the camera runs."""
        return self._source.version(view)

    def content(self, view: int) -> str:
        """A hash of the source's content and the view's zones."""
        content = self._source.content(view)
        if not content or view not in self.zones:
            return content
        return hashlib.sha256(repr((content, self.zones[view])).encode()).hexdigest()

    def latest(self, view: int) -> Picture:
        """The picture with its zones painted black, and without depth and instances there."""
        picture = self._source.latest(view)
        if view not in self.zones:
            return picture
        mask = self._mask(view, *picture.rgb.shape[:2])
        truth = picture.truth
        return replace(
            picture,
            rgb=np.where(mask[..., None], np.uint8(0), picture.rgb),
            depth_m=np.where(mask, np.float32(0.0), picture.depth_m),
            truth=None if truth is None else replace(truth, ids=np.where(mask, np.uint16(0), truth.ids)),
        )

    def _mask(self, view: int, height_px: int, width_px: int) -> NDArray[np.bool_]:
        key = view, height_px, width_px
        if key not in self._masks:
            self._masks[key] = pixels_in(self.zones[view], width_px, height_px)
        return self._masks[key]
