"""What open-vocabulary detectors share. Their networks output queries, each a box with a score for every word."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from surveilnav.perception.boxes import Boxes, merge_overlapping

#: Detects words in a batch of pictures, which have one size and the same words.
BatchDetector = Callable[[Sequence[NDArray[np.uint8]], tuple[str, ...]], list[Boxes]]


def detect_in_groups(
    images: Sequence[NDArray[np.uint8]],
    words: Sequence[Sequence[str]],
    detect: BatchDetector,
    refusal: Callable[[str], str],
) -> list[Boxes]:
    """``Detector.detect`` by means of ``detect``, which processes pictures of the same size with the same words as a batch.

    Such pictures need no padding, so that none influences the result of another. Words with a ``refusal`` aren't looked for,
    and their scores are zero: a single word must not make a view fail.
    """
    found = [Boxes.empty(tuple(wanted)) for wanted in words]
    groups: dict[tuple[tuple[int, ...], tuple[str, ...]], list[int]] = {}
    for row, (image, wanted) in enumerate(zip(images, words, strict=True)):
        if searched := tuple(word for word in wanted if not refusal(word)):
            groups.setdefault((image.shape, searched), []).append(row)
    for (_, searched), rows in groups.items():
        for row, boxes in zip(rows, detect([images[row] for row in rows], searched), strict=True):
            found[row] = _with_all_words(boxes, tuple(words[row]), refusal)
    return found


def _with_all_words(boxes: Boxes, wanted: tuple[str, ...], refusal: Callable[[str], str]) -> Boxes:
    """The boxes with columns of zeros for the words that weren't looked for."""
    scores = np.zeros((len(boxes), len(wanted)), np.float32)
    scores[:, [column for column, word in enumerate(wanted) if not refusal(word)]] = boxes.scores
    return Boxes(boxes.xyxy, scores, wanted)


def to_corners(cxcywh: NDArray[np.float32], width_px: float, height_px: float) -> NDArray[np.float32]:
    """Boxes (N, 4) xyxy [pixels] from centres and sizes (N, 4) in shares of a picture's sides."""
    centre, half = cxcywh[:, :2], cxcywh[:, 2:] / 2
    scale = np.array([width_px, height_px] * 2, np.float32)
    return np.asarray(np.concatenate([centre - half, centre + half], axis=1) * scale, np.float32)


def select_queries(
    xyxy: NDArray[np.float32], scores: NDArray[np.float32], words: Sequence[str], threshold: float, floor: float = 0.0
) -> Boxes:
    """The queries whose best word reaches ``threshold``.

    Args:
        xyxy: (Q, 4) boxes [pixels].
        scores: (Q, W); those below ``floor`` are set to zero.
        words: names of the W columns.
    """
    keep = scores.max(axis=1) >= threshold
    kept = np.where(scores >= floor, scores, 0.0).astype(np.float32)
    return Boxes(xyxy[keep], kept[keep], tuple(words))


def merge_queries(parts: Sequence[Boxes], same_thing_iou: float, width_px: int, height_px: int) -> Boxes:
    """The boxes of several passes, one per object, best first. Those that are outside the picture or not finite are dropped."""
    return merge_overlapping(Boxes.concatenate(parts).clipped(width_px, height_px), same_thing_iou)
