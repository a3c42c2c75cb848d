"""AP50: how well a detector ranks what it finds of one class over many views."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from surveilnav.perception.boxes import overlaps

_IOU = 0.5


@dataclass(slots=True)
class ClassTally:
    """Detections of one class, judged view by view. ``objects``: how many count."""

    objects: int = 0
    scores: list[float] = field(default_factory=list)
    right: list[bool] = field(default_factory=list)

    def add(
        self,
        found: NDArray[np.float32],
        scores: NDArray[np.float32],
        true: NDArray[np.float32],
        counts: NDArray[np.bool_],
    ) -> None:
        """Judges one view.

        Args:
            found: (N, 4) boxes xyxy, ``scores`` (N,).
            true: (M, 4) boxes of the class; those that don't ``counts`` (M,), being too small, are neither asked for nor
                held against whoever finds them.
        """
        self.objects += int(counts.sum())
        iou, _ = (
            overlaps(found, true) if len(found) and len(true) else (np.zeros((len(found), len(true)), np.float32), None)
        )
        free = np.ones(len(true), bool)
        for i in np.argsort(-scores, kind="stable").tolist():
            fits = np.flatnonzero(free & (iou[i] >= _IOU))
            best = max(fits.tolist(), key=lambda j: (bool(counts[j]), iou[i, j]), default=-1)
            if best >= 0:
                free[best] = False
                if not counts[best]:
                    continue
            self.scores.append(float(scores[i]))
            self.right.append(best >= 0)

    @property
    def ap(self) -> float:
        """The area under the precision that is reached at each recall or beyond; NaN without objects."""
        if not self.objects:
            return math.nan
        order = np.argsort(-np.array(self.scores), kind="stable")
        right = np.cumsum(np.array(self.right, bool)[order])
        if not len(right):
            return 0.0
        recall, precision = right / self.objects, right / np.arange(1, len(right) + 1)
        beyond = np.maximum.accumulate(precision[::-1])[::-1]
        return float((np.diff(recall, prepend=0.0) * beyond).sum())
