"""A backend made of three models: a detector, a segmenter and an embedder, each of which takes batches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from surveilnav.messages import ModelIds
from surveilnav.perception.backend import Backend, Stage, ViewTask
from surveilnav.perception.boxes import Boxes
from surveilnav.perception.chances import ChanceTable
from surveilnav.perception.protocols import ChecksWords, Detector, Embedder, RgbdView, Segmenter
from surveilnav.perception.sizes import WRONG_SIZE_FACTOR, extent_m, is_plausible
from surveilnav.sensing.views import DetectedObject, ViewPerception

_EDGE_PX = 3.0  # a box that ends so near to the picture's edge is cut by it


class PipelineBackend(Backend):
    """Runs a detector, a segmenter and an embedder one after the other.

    Args:
        name, why, best_batch, chances: see ``Backend``.
        min_score: objects with a lower score aren't reported. The embedder gets their boxes all the same, because they may
            count for the view's embedding.
        extents_m: by class, the smallest and largest extent of its objects. An object that depth shows to be of another size
            gets a lower score.
    """

    def __init__(
        self,
        name: str,
        why: str,
        detector: Detector,
        segmenter: Segmenter,
        embedder: Embedder,
        *,
        min_score: float,
        extents_m: Mapping[str, tuple[float, float]] | None = None,
        best_batch: int = 1,
        chances: ChanceTable | None = None,
    ) -> None:
        self.name, self.why = name, why
        self.detector, self.segmenter, self.embedder = detector, segmenter, embedder
        self.models = ModelIds(detector.model, segmenter.model, embedder.model)
        self.vocabulary, self.embedding_dim = detector.vocabulary, embedder.dim
        self.needs_prompts = detector.vocabulary is None
        self.best_batch, self.chances = best_batch, chances
        self._min_score, self._extents_m = min_score, extents_m or {}
        self.stages = (
            Stage("detect", self._detect),
            Stage("segment", self._segment),
            Stage("embed", self._embed),
            *([Stage("calibrate", self.assign_chances)] if chances else []),
        )

    def refusal(self, word: str) -> str:
        """See ``Backend.refusal``. The detector may have reasons of its own (``ChecksWords``)."""
        own = self.detector.refusal(word) if isinstance(self.detector, ChecksWords) else ""
        return super().refusal(word) or own

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        return self.embedder.embed_texts(texts)

    def _detect(self, batch: Sequence[ViewTask]) -> None:
        found = self.detector.detect([w.view.rgb for w in batch], [w.prompts for w in batch])
        for task, boxes in zip(batch, found, strict=True):
            task.boxes = boxes
            task.searched_words = tuple(task.prompts if self.vocabulary is None else self.vocabulary)

    def _segment(self, batch: Sequence[ViewTask]) -> None:
        likely = [np.flatnonzero(w.boxes.best_scores >= self._min_score) for w in batch]
        xyxy = [w.boxes.xyxy[rows] for w, rows in zip(batch, likely, strict=True)]
        masks_by_view = self.segmenter.segment([w.view for w in batch], xyxy)
        for task, rows, masks in zip(batch, likely, masks_by_view, strict=True):
            task.boxes = self._reduce_wrong_sizes(task.view, task.boxes, rows, masks)
            kept = np.flatnonzero(task.boxes.best_scores[rows] >= self._min_score)
            task.rows, task.masks = rows[kept], [masks[i] for i in kept]

    def _embed(self, batch: Sequence[ViewTask]) -> None:
        images, boxes = [w.view.rgb for w in batch], [w.boxes for w in batch]
        embeddings = self.embedder.embed_views(images, boxes, [w.rows for w in batch])
        for task, embedding in zip(batch, embeddings, strict=True):
            labels, best = task.boxes.labels, task.boxes.best_scores
            detections = [
                DetectedObject(labels[row], min(1.0, float(best[row])), _box(task.boxes.xyxy[row]), mask, vector)
                for row, mask, vector in zip(task.rows.tolist(), task.masks, embedding.objects, strict=True)
            ]
            detections.sort(key=lambda d: -d.score)
            task.result = ViewPerception(
                self.name, tuple(detections), embedding.image, self.embedder.model, task.searched_words
            )

    def _reduce_wrong_sizes(
        self, view: RgbdView, boxes: Boxes, rows: NDArray[np.int64], masks: Sequence[NDArray[np.bool_] | None]
    ) -> Boxes:
        """The boxes with reduced scores where an object's size doesn't fit the class with its highest score."""
        wrong = [
            row
            for row, mask in zip(rows.tolist(), masks, strict=True)
            if mask is not None and not self._size_fits(view, boxes.labels[row], _box(boxes.xyxy[row]), mask)
        ]
        scores = boxes.scores.copy()
        scores[wrong] *= WRONG_SIZE_FACTOR
        return boxes.with_scores(scores)

    def _size_fits(
        self, view: RgbdView, label: str, box: tuple[float, float, float, float], mask: NDArray[np.bool_]
    ) -> bool:
        if label not in self._extents_m:
            return True
        x0, y0, x1, y1 = box
        right, bottom = view.camera.width_px - _EDGE_PX, view.camera.height_px - _EDGE_PX
        cut = x0 < _EDGE_PX or y0 < _EDGE_PX or x1 > right or y1 > bottom
        size_m = extent_m(view.depth_m, view.camera, box, mask)
        return size_m is None or is_plausible(self._extents_m, label, size_m, cut)


def _box(xyxy: NDArray[np.float32]) -> tuple[float, float, float, float]:
    x0, y0, x1, y1 = (float(v) for v in xyxy)
    return x0, y0, x1, y1
