"""What detectors with an open vocabulary share: they answer with queries, each a box and a score for every word."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from surveilnav.perception.boxes import Boxes, merge_overlapping

#: Finds words in pictures of one size, all asked for the same words.
Finder = Callable[[Sequence[NDArray[np.uint8]], tuple[str, ...]], list[Boxes]]


def in_groups(
    images: Sequence[NDArray[np.uint8]], words: Sequence[Sequence[str]], find: Finder, refusal: Callable[[str], str]
) -> list[Boxes]:
    """``Detector.detect`` by a ``find`` that gets as a batch what has one size and the same words: such pictures need no
    padding, so none changes what is said of another.

    Words that the detector refuses aren't looked for, and their columns are zero: one word doesn't blind a view.
    """
    found = [Boxes.empty(tuple(asked)) for asked in words]
    groups: dict[tuple[tuple[int, ...], tuple[str, ...]], list[int]] = {}
    for row, (image, asked) in enumerate(zip(images, words, strict=True)):
        if sought := tuple(word for word in asked if not refusal(word)):
            groups.setdefault((image.shape, sought), []).append(row)
    for (_, sought), rows in groups.items():
        for row, boxes in zip(rows, find([images[row] for row in rows], sought), strict=True):
            found[row] = _widened(boxes, tuple(words[row]), refusal)
    return found


def _widened(boxes: Boxes, asked: tuple[str, ...], refusal: Callable[[str], str]) -> Boxes:
    """The boxes with a column for every word asked for."""
    scores = np.zeros((len(boxes), len(asked)), np.float32)
    scores[:, [column for column, word in enumerate(asked) if not refusal(word)]] = boxes.scores
    return Boxes(boxes.xyxy, scores, asked)


def corners(cxcywh: NDArray[np.float32], width_px: float, height_px: float) -> NDArray[np.float32]:
    """Boxes (N, 4) xyxy [pixels] of centres and sizes in shares of a picture's sides."""
    centre, half = cxcywh[:, :2], cxcywh[:, 2:] / 2
    scale = np.array([width_px, height_px] * 2, np.float32)
    return np.asarray(np.concatenate([centre - half, centre + half], axis=1) * scale, np.float32)


def chosen(
    xyxy: NDArray[np.float32], scores: NDArray[np.float32], words: Sequence[str], threshold: float, floor: float = 0.0
) -> Boxes:
    """Of queries (Q, 4) and (Q, W) those whose best word reaches ``threshold``; scores below ``floor`` count as unsaid."""
    keep = scores.max(axis=1) >= threshold
    said = np.where(scores >= floor, scores, 0.0).astype(np.float32)
    return Boxes(xyxy[keep], said[keep], tuple(words))


def things(parts: Sequence[Boxes], same_thing_iou: float, width_px: int, height_px: int) -> Boxes:
    """One box a thing, the best first, in the picture. What has no extent in it, or isn't a number, goes first."""
    return merge_overlapping(Boxes.concatenate(parts).clipped(width_px, height_px), same_thing_iou)
