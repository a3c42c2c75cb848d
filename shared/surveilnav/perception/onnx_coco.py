"""The backend ``onnx-coco``: COCO detectors that have to agree, masks from depth, closed-set embeddings.

Large views (cameras: 1280 x 1280) hold things too small for networks that see 416 pixels, so the first detector looks
at them in overlapping quarters too; small ones (robots: 640 x 480) are looked at whole.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.categories import COCO
from surveilnav.geometry import Pinhole
from surveilnav.perception import closed_set
from surveilnav.perception.boxes import Boxes, agreed, merged
from surveilnav.perception.detectors import Detector
from surveilnav.perception.masks import floor_of, mask_of
from surveilnav.perception.sizes import WRONG_SIZE, extent_m, plausible
from surveilnav.sensing.views import Detected, TrueInstances, ViewPerception


@dataclass(frozen=True, slots=True)
class Thresholds:
    """What counts. Chosen on rendered Sweet Home 3D homes (206 robot views, 50 camera views; ``benchmark.studies.detectors``).

    Attributes:
        min_score: weaker detections are kept out of the answer (they still tint the image embedding).
        same_thing_iou: boxes of one detector that overlap so much are one thing.
        agreement_iou: boxes of two detectors that overlap so much are one thing.
        alone: the share of its score that a box keeps of the silent detector's vote (0: halved, 1: as if both agreed).
        wrong_size: what the score of a thing is multiplied with whose size isn't its class's.
        tile_from_px: views with a longer side from here on are tiled.
        tile_overlap: share of a tile's side that it shares with its neighbour.
        inside: share of a box inside a larger one of its class from which it is a piece cut by a tile.
    """

    min_score: float = 0.25
    same_thing_iou: float = 0.6
    agreement_iou: float = 0.5
    alone: float = 0.0
    wrong_size: float = WRONG_SIZE
    tile_from_px: int = 900
    tile_overlap: float = 0.2
    inside: float = 0.8


class OnnxCoco:
    """See the module's docstring. ``small``, ``large``: the detectors of small and of large views; the first tiles."""

    name = "onnx-coco"
    embedding_dim = closed_set.DIM
    needs_truth = False

    def __init__(
        self,
        small: Sequence[Detector],
        why: str,
        *,
        large: Sequence[Detector] | None = None,
        thresholds: Thresholds | None = None,
    ) -> None:
        self._small = tuple(small)
        self._large = tuple(large) if large is not None else self._small
        self.why = why
        self.thresholds = thresholds or Thresholds()

    def perceive(
        self,
        rgb: NDArray[np.uint8],
        depth_m: NDArray[np.float32],
        camera: Pinhole,
        *,
        prompts: Sequence[str] = (),
        truth: TrueInstances | None = None,
        key: tuple[object, ...] = (),
    ) -> ViewPerception:
        """See ``Backend.perceive``. ``prompts``, ``truth`` and ``key`` don't matter here."""
        boxes = self.boxes_of(rgb)
        likely = np.flatnonzero(boxes.best >= self.thresholds.min_score)
        floor = floor_of(depth_m, camera) if len(likely) else None
        scores = boxes.scores.copy()
        detections = []
        for i in likely:
            x0, y0, x1, y1 = (float(v) for v in boxes.xyxy[i])
            mask = mask_of(depth_m, (x0, y0, x1, y1), floor)
            label = COCO[int(scores[i].argmax())]
            size_m = extent_m(depth_m, camera, (x0, y0, x1, y1), mask) if mask is not None else None
            cut = x0 < 3 or y0 < 3 or x1 > camera.width_px - 3 or y1 > camera.height_px - 3
            if size_m is not None and not plausible(label, size_m, cut):
                scores[i] *= self.thresholds.wrong_size
            score = float(min(1.0, scores[i].max()))
            if score >= self.thresholds.min_score:
                embedding = closed_set.embed_object(scores[i])
                detections.append(Detected(label, score, (x0, y0, x1, y1), mask, embedding))
        detections.sort(key=lambda d: -d.score)
        return ViewPerception(self.name, tuple(detections), closed_set.embed_image(scores))

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        return closed_set.embed_texts(texts)

    def boxes_of(self, rgb: NDArray[np.uint8]) -> Boxes:
        """What the detectors agree on in (height, width, 3) uint8, weak boxes included, best first."""
        t = self.thresholds
        height, width = rgb.shape[:2]
        is_large = max(height, width) >= t.tile_from_px
        views = []
        for i, detector in enumerate(self._large if is_large else self._small):
            tiles = [(0, 0, width, height)]
            if is_large and i == 0:
                tiles += quarters(width, height, t.tile_overlap)
            found = [self._in_tile(detector, rgb, tile) for tile in tiles]
            views.append(merged(Boxes.joined(found), t.same_thing_iou, t.inside if len(tiles) > 1 else 2.0))
        boxes = agreed(views, t.agreement_iou, t.alone)
        return boxes.where(np.argsort(-boxes.best, kind="stable"))

    @staticmethod
    def _in_tile(detector: Detector, rgb: NDArray[np.uint8], tile: tuple[int, int, int, int]) -> Boxes:
        """Boxes in a tile, in pixels of the whole picture; what touches a cut edge counts less: it may be a piece."""
        x0, y0, x1, y1 = tile
        found = detector.detect(np.ascontiguousarray(rgb[y0:y1, x0:x1]))
        if not len(found):
            return found
        height, width = rgb.shape[:2]
        b = found.xyxy
        cut = (
            ((b[:, 0] < 3) & (x0 > 0)) | ((b[:, 1] < 3) & (y0 > 0))
            | ((b[:, 2] > x1 - x0 - 3) & (x1 < width)) | ((b[:, 3] > y1 - y0 - 3) & (y1 < height))
        )  # fmt: skip
        return Boxes(b, found.scores * np.where(cut, 0.5, 1.0)[:, None].astype(np.float32)).shifted(x0, y0)


def quarters(width_px: int, height_px: int, overlap: float) -> list[tuple[int, int, int, int]]:
    """Four tiles (x0, y0, x1, y1) that cover the picture and share ``overlap`` of their sides."""
    w, h = math.ceil(width_px / (2 - overlap)), math.ceil(height_px / (2 - overlap))
    return [(x, y, x + w, y + h) for y in (0, height_px - h) for x in (0, width_px - w)]
