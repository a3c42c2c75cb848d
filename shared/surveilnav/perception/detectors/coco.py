"""Detectors of COCO's 80 classes: small networks whose results are combined, so that one alone isn't believed.

Large pictures (cameras: 1280 x 1280) show objects that are too small for networks with an input of 416 pixels. The first
network therefore also sees overlapping quarters of them. Small pictures (robots: 640 x 480) are seen only as a whole.
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
from surveilnav.perception.boxes import Boxes, merge_overlapping, weighted_box_fusion
from surveilnav.perception.detectors.deimv2 import Deimv2
from surveilnav.perception.detectors.onnx_file import open_session
from surveilnav.perception.detectors.picodet import Picodet
from surveilnav.perception.detectors.yolox import Yolox
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.vocabulary import COCO


class Network(Protocol):
    """One network that detects objects of COCO's classes. ``name``: shown to people."""

    name: str

    def detect(self, rgb: NDArray[np.uint8]) -> Boxes:
        """Boxes in a picture (height, width, 3) uint8, in its pixels. Duplicates may be included: they are merged later."""
        ...


_FAMILIES: dict[str, Any] = {"yolox": Yolox, "deimv2": Deimv2, "picodet": Picodet}


def load(path: Path, family: str, runtime: Runtime) -> Network:
    """Loads a detector of COCO's classes from an ONNX file.

    Args:
        family: the architecture, which decides how inputs and outputs are read: "yolox", "deimv2" or "picodet".

    Raises:
        PerceptionError: the file can't be loaded, or the family is unknown.
    """
    if family not in _FAMILIES:
        raise PerceptionError(f"expected a family of detectors out of {sorted(_FAMILIES)}, got {family!r}")
    opened = open_session(path, runtime)
    try:
        network: Network = _FAMILIES[family](path.stem, opened)
        return network
    except Exception as error:  # a network of another family has inputs of other shapes
        raise PerceptionError(f"{path.name} can't be loaded as a {family} network: {error}") from error


@dataclass(frozen=True, slots=True)
class Agreement:
    """Which boxes are taken for one object.

    The values were chosen on rendered Sweet Home 3D homes (206 robot views, 50 camera views).

    Attributes:
        same_thing_iou: boxes of one network with at least this IoU are one object.
        agreement_iou: boxes of two networks with at least this IoU are one object.
        silent_vote: see ``weighted_box_fusion``; 0 halves the score of a box that only one of two networks reports.
        tile_from_px: pictures with a side of at least this length are tiled.
        tile_overlap: share of a tile's side that it shares with its neighbour.
        inside: a box of which this share lies inside a larger one of its class is a piece cut by a tile.
    """

    same_thing_iou: float = 0.6
    agreement_iou: float = 0.5
    silent_vote: float = 0.0
    tile_from_px: int = 900
    tile_overlap: float = 0.2
    inside: float = 0.8


class CocoDetector:
    """See the module's docstring. ``small``, ``large``: the networks for small and for large pictures (None: the same)."""

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
        """See ``Detector.detect``. Pictures are processed one by one, because the files have a batch size of 1."""
        return [self.detect_one(rgb) for rgb in images]

    def detect_one(self, rgb: NDArray[np.uint8]) -> Boxes:
        """The combined boxes of all networks in a picture (height, width, 3) uint8, best first, weak ones included."""
        a = self.agreement
        height, width = rgb.shape[:2]
        is_large = max(height, width) >= a.tile_from_px
        views = []
        for i, network in enumerate(self._large if is_large else self._small):
            tiles = [(0, 0, width, height)]
            if is_large and i == 0:
                tiles += quarters(width, height, a.tile_overlap)
            found = [_in_tile(network, rgb, tile) for tile in tiles]
            views.append(
                merge_overlapping(Boxes.concatenate(found), a.same_thing_iou, a.inside if len(tiles) > 1 else 2.0)
            )
        boxes = weighted_box_fusion(views, a.agreement_iou, a.silent_vote)
        return boxes.select(np.argsort(-boxes.best_scores, kind="stable"))


def _in_tile(network: Network, rgb: NDArray[np.uint8], tile: tuple[int, int, int, int]) -> Boxes:
    """Boxes in a tile, in pixels of the whole picture. Those at a cut edge get half the score: they may be pieces."""
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
    return found.with_scores(found.scores * np.where(cut, 0.5, 1.0)[:, None].astype(np.float32)).shifted(x0, y0)


def quarters(width_px: int, height_px: int, overlap: float) -> list[tuple[int, int, int, int]]:
    """Four tiles (x0, y0, x1, y1) that cover the picture and overlap by the share ``overlap`` of their sides."""
    w, h = math.ceil(width_px / (2 - overlap)), math.ceil(height_px / (2 - overlap))
    return [(x, y, x + w, y + h) for y in (0, height_px - h) for x in (0, width_px - w)]
