"""Boxes with a score for each word: overlap, merging of duplicates, weighted box fusion of several detectors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """N boxes of one picture, and how well each of W words fits each of them.

    Attributes:
        xyxy: (N, 4) float32 corners x0, y0, x1, y1 [pixels].
        scores: (N, W) float32, 0-1; zero where the detector reports no score.
        words: names of the W columns.
    """

    xyxy: NDArray[np.float32]
    scores: NDArray[np.float32]
    words: Sequence[str]

    @classmethod
    def empty(cls, words: Sequence[str] = ()) -> Boxes:
        return cls(np.zeros((0, 4), np.float32), np.zeros((0, len(words)), np.float32), words)

    @classmethod
    def concatenate(cls, parts: Sequence[Boxes]) -> Boxes:
        """The boxes of all ``parts``, of which there is at least one. All must have the same words."""
        full = [p for p in parts if len(p)] or list(parts[:1])
        xyxy, scores = np.concatenate([p.xyxy for p in full]), np.concatenate([p.scores for p in full])
        return cls(xyxy, scores, full[0].words)

    def __len__(self) -> int:
        return len(self.xyxy)

    @property
    def best_scores(self) -> NDArray[np.float32]:
        """(N,) highest score of each box."""
        return self.scores.max(axis=1) if len(self) else np.zeros(0, np.float32)

    @property
    def labels(self) -> list[str]:
        """The word with the highest score, for each box."""
        return [self.words[i] for i in self.scores.argmax(axis=1).tolist()] if len(self) else []

    def select(self, keep: NDArray) -> Boxes:
        return Boxes(self.xyxy[keep], self.scores[keep], self.words)

    def with_scores(self, scores: NDArray[np.float32]) -> Boxes:
        """The same boxes with other scores (N, W)."""
        return Boxes(self.xyxy, scores, self.words)

    def shifted(self, x_px: float, y_px: float) -> Boxes:
        return Boxes(self.xyxy + np.array([x_px, y_px, x_px, y_px], np.float32), self.scores, self.words)

    def clipped(self, width_px: int, height_px: int, smallest_px: float = 4.0) -> Boxes:
        """The boxes clipped to the picture, without those that have a side shorter than ``smallest_px`` afterwards."""
        xyxy = np.clip(self.xyxy, 0, np.array([width_px, height_px, width_px, height_px], np.float32))
        keep = (xyxy[:, 2:] - xyxy[:, :2]).min(axis=1, initial=np.inf) >= smallest_px
        return Boxes(xyxy[keep], self.scores[keep], self.words)


def overlaps(a: NDArray[np.float32], b: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Overlap of all pairs of two sets of boxes (A, 4) and (B, 4).

    Returns:
        (A, B) intersection over union, and (A, B) share of the smaller box that lies inside the other.
    """
    across, along = (
        np.maximum(np.minimum.outer(a[:, k + 2], b[:, k + 2]) - np.maximum.outer(a[:, k], b[:, k]), 0) for k in (0, 1)
    )
    common = across * along
    area_a, area_b = (a[:, 2:] - a[:, :2]).prod(axis=1), (b[:, 2:] - b[:, :2]).prod(axis=1)
    union = area_a[:, None] + area_b[None, :] - common
    smaller = np.minimum(area_a[:, None], area_b[None, :])
    return common / np.maximum(union, 1e-6), common / np.maximum(smaller, 1e-6)


def merge_overlapping(boxes: Boxes, iou: float, inside: float = 2.0, max_boxes: int = 300) -> Boxes:
    """Merges boxes that overlap into one per object, whatever their classes, best first.

    Like non-maximum suppression, but the remaining box gets each class's highest score among those it replaces.

    Args:
        iou: boxes with at least this IoU are merged.
        inside: boxes of the same class are also merged if at least this share of one lies inside the better one, as pieces of
            an object cut by tiles do; 2: never.
        max_boxes: only so many of the best boxes are compared; the others are dropped.
    """
    return merge_overlapping_rows(boxes, iou, inside, max_boxes)[0]


def merge_overlapping_rows(
    boxes: Boxes, iou: float, inside: float = 2.0, max_boxes: int = 300
) -> tuple[Boxes, NDArray[np.int64]]:
    """``merge_overlapping``, and the row (N,) of ``boxes`` that each remaining box was."""
    order = np.argsort(-boxes.best_scores, kind="stable")[:max_boxes]
    boxes = boxes.select(order)
    if not len(boxes):
        return boxes, order
    iou_of, inside_of = overlaps(boxes.xyxy, boxes.xyxy)
    same = iou_of >= iou
    if inside <= 1.0:
        label = boxes.scores.argmax(axis=1)
        same |= (inside_of >= inside) & (label[:, None] == label[None, :])
    np.fill_diagonal(same, val=True)
    free = np.ones(len(boxes), bool)
    keep, scores = [], []
    for i in range(len(boxes)):
        if free[i]:
            group = np.flatnonzero(same[i] & free)
            free[group] = False
            keep.append(i)
            scores.append(boxes.scores[i] if len(group) == 1 else boxes.scores[group].max(axis=0))
    return Boxes(boxes.xyxy[keep], np.array(scores), boxes.words), order[keep]


def weighted_box_fusion(views: Sequence[Boxes], iou: float, silent_vote: float) -> Boxes:
    """Combines the boxes of several detectors of one picture (Solovyev et al. 2021), with class scores instead of one label.

    Boxes of different detectors that overlap are one object. Its box is the mean weighted by scores, its class scores are the
    mean over all detectors.

    Args:
        views: the boxes of each detector, all with the same words.
        iou: boxes with at least this IoU are one object.
        silent_vote: share of the best box's scores that a detector without a matching box contributes to the mean. 0: none,
            as in the paper; 1: as if it agreed.
    """
    if len(views) == 1:
        return views[0]
    xyxy = np.concatenate([v.xyxy for v in views])
    scores = np.concatenate([v.scores for v in views])
    owner = np.concatenate([np.full(len(v), i) for i, v in enumerate(views)])
    order = np.argsort(-scores.max(axis=1), kind="stable") if len(xyxy) else np.zeros(0, int)
    overlap, _ = overlaps(xyxy, xyxy)
    taken = np.zeros(len(xyxy), bool)
    out_boxes, out_scores = [], []
    for i in order:
        if taken[i]:
            continue
        members = [i]
        for other in range(len(views)):  # the best match of each other detector
            free = np.flatnonzero(~taken & (owner == other) & (overlap[i] >= iou))
            if other != owner[i] and len(free):
                members.append(free[np.argmax(overlap[i, free])])
        taken[members] = True
        weights = scores[members].max(axis=1)
        out_boxes.append((xyxy[members] * weights[:, None]).sum(axis=0) / weights.sum())
        total = scores[members].sum(axis=0) + silent_vote * (len(views) - len(members)) * scores[i]
        out_scores.append(total / len(views))
    if not out_boxes:
        return Boxes.empty(views[0].words)
    return Boxes(np.array(out_boxes, np.float32), np.array(out_scores, np.float32), views[0].words)
