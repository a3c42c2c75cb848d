"""Detectors of COCO's classes: small networks, two of which have to agree.

Large views (cameras: 1280 x 1280) hold things too small for networks that see 416 pixels, so the first network looks
at them in overlapping quarters too; small ones (robots: 640 x 480) are looked at whole.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import PerceptionError
from surveilnav.perception.boxes import Boxes, agreed, merged
from surveilnav.perception.detectors.deimv2 import Deimv2
from surveilnav.perception.detectors.onnx_file import session
from surveilnav.perception.detectors.picodet import Picodet
from surveilnav.perception.detectors.yolox import Yolox
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.vocabulary import COCO


class Network(Protocol):
    """One network that finds things of COCO's classes. ``name``: for people."""

    name: str

    def detect(self, rgb: NDArray[np.uint8]) -> Boxes:
        """Boxes of (height, width, 3) uint8, duplicates included, in its pixels."""
        ...


_FAMILIES: dict[str, Any] = {"yolox": Yolox, "deimv2": Deimv2, "picodet": Picodet}


def load(path: Path, family: str, runtime: Runtime) -> Network:
    """The network in an ONNX file of that family.

    Raises:
        PerceptionError: the file can't be loaded, or the family is unknown.
    """
    if family not in _FAMILIES:
        raise PerceptionError(f"expected a family of detectors out of {sorted(_FAMILIES)}, got {family!r}")
    opened = session(path, runtime)
    try:
        network: Network = _FAMILIES[family](path.stem, opened)
        return network
    except Exception as error:  # another network than the family's: its inputs have other shapes
        raise PerceptionError(f"{path.name} can't be loaded as a {family} network: {error}") from error


@dataclass(frozen=True, slots=True)
class Agreement:
    """When boxes are one thing. Chosen on rendered Sweet Home 3D homes (206 robot views, 50 camera views).

    Attributes:
        same_thing_iou: boxes of one network that overlap so much are one thing.
        agreement_iou: boxes of two networks that overlap so much are one thing.
        alone: the share of its score that a box keeps of the silent network's vote (0: halved, 1: as if both agreed).
        tile_from_px: views with a longer side from here on are tiled.
        tile_overlap: share of a tile's side that it shares with its neighbour.
        inside: share of a box inside a larger one of its class from which it is a piece cut by a tile.
    """

    same_thing_iou: float = 0.6
    agreement_iou: float = 0.5
    alone: float = 0.0
    tile_from_px: int = 900
    tile_overlap: float = 0.2
    inside: float = 0.8


class CocoDetector:
    """See the module's docstring. ``small``, ``large``: the networks of small and of large views; the first tiles."""

    vocabulary = COCO

    def __init__(
        self,
        small: Sequence[Network],
        large: Sequence[Network] | None = None,
        *,
        model: str = "coco",
        agreement: Agreement | None = None,
    ) -> None:
        self.model, self.agreement = model, agreement or Agreement()
        self._small = tuple(small)
        self._large = tuple(large) if large is not None else self._small

    def detect(self, images: Sequence[NDArray[np.uint8]], words: Sequence[Sequence[str]] = ()) -> list[Boxes]:
        """See ``Detector.detect``: one picture after the other, since these networks' files take one."""
        return [self.boxes_of(rgb) for rgb in images]

    def boxes_of(self, rgb: NDArray[np.uint8]) -> Boxes:
        """What the networks agree on in (height, width, 3) uint8, weak boxes included, best first."""
        a = self.agreement
        height, width = rgb.shape[:2]
        is_large = max(height, width) >= a.tile_from_px
        views = []
        for i, network in enumerate(self._large if is_large else self._small):
            tiles = [(0, 0, width, height)]
            if is_large and i == 0:
                tiles += quarters(width, height, a.tile_overlap)
            found = [_in_tile(network, rgb, tile) for tile in tiles]
            views.append(merged(Boxes.joined(found), a.same_thing_iou, a.inside if len(tiles) > 1 else 2.0))
        boxes = agreed(views, a.agreement_iou, a.alone)
        return boxes.where(np.argsort(-boxes.best, kind="stable"))


def _in_tile(network: Network, rgb: NDArray[np.uint8], tile: tuple[int, int, int, int]) -> Boxes:
    """Boxes in a tile, in pixels of the whole picture; what touches a cut edge counts less: it may be a piece."""
    x0, y0, x1, y1 = tile
    found = network.detect(np.ascontiguousarray(rgb[y0:y1, x0:x1]))
    height, width = rgb.shape[:2]
    b = found.xyxy
    cut = (
        ((b[:, 0] < 3) & (x0 > 0))
        | ((b[:, 1] < 3) & (y0 > 0))
        | ((b[:, 2] > x1 - x0 - 3) & (x1 < width))
        | ((b[:, 3] > y1 - y0 - 3) & (y1 < height))
    )
    return found.scored(found.scores * np.where(cut, 0.5, 1.0)[:, None].astype(np.float32)).shifted(x0, y0)


def quarters(width_px: int, height_px: int, overlap: float) -> list[tuple[int, int, int, int]]:
    """Four tiles (x0, y0, x1, y1) that cover the picture and share ``overlap`` of their sides."""
    w, h = math.ceil(width_px / (2 - overlap)), math.ceil(height_px / (2 - overlap))
    return [(x, y, x + w, y + h) for y in (0, height_px - h) for x in (0, width_px - w)]
