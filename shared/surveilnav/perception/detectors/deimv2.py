"""DEIMv2 on COCO's classes, as an ONNX file."""

from __future__ import annotations

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from surveilnav.perception.boxes import Boxes
from surveilnav.perception.detectors.onnx_file import SCORE_FLOOR
from surveilnav.perception.vocabulary import COCO


class Deimv2:
    """DEIMv2 (Huang et al. 2025), a DETR.

    Input: the picture stretched to a square, RGB 0-1. Output: labels, boxes and scores of its best queries.
    """

    def __init__(self, name: str, session: onnxruntime.InferenceSession) -> None:
        self.name, self._session = name, session
        self._size = int(session.get_inputs()[0].shape[2])

    def detect(self, rgb: NDArray[np.uint8]) -> Boxes:
        height, width = rgb.shape[:2]
        small = cv2.resize(rgb, (self._size, self._size), interpolation=cv2.INTER_LINEAR)
        tensor = small.transpose(2, 0, 1)[None].astype(np.float32) / np.float32(255)
        sizes = np.array([[width, height]], np.int64)
        labels, boxes, scores = self._session.run(
            ["labels", "boxes", "scores"], {"images": tensor, "orig_target_sizes": sizes}
        )
        keep = scores[0] >= SCORE_FLOOR
        table = np.zeros((int(keep.sum()), len(COCO)), np.float32)
        table[np.arange(len(table)), np.clip(labels[0][keep], 0, len(COCO) - 1)] = scores[0][keep]
        return Boxes(boxes[0][keep].astype(np.float32), table, COCO).clipped(width, height)
