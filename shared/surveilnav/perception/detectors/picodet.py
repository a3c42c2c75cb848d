"""PicoDet on COCO's classes, as an ONNX file."""

from __future__ import annotations

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from surveilnav.perception.boxes import Boxes
from surveilnav.perception.detectors.onnx_file import SCORE_FLOOR
from surveilnav.perception.vocabulary import COCO


class Picodet:
    """PicoDet (Yu et al. 2021).

    Input: the picture stretched to a square, BGR, normalised. Output: for each stride, class scores and the distributions of
    the distances to the box's sides.
    """

    _MEAN = np.array([103.53, 116.28, 123.675], np.float32)
    _STD = np.array([57.375, 57.12, 58.395], np.float32)

    def __init__(self, name: str, session: onnxruntime.InferenceSession) -> None:
        self.name, self._session = name, session
        entry = session.get_inputs()[0]
        self._input, self._size = entry.name, int(entry.shape[2])

    def detect(self, rgb: NDArray[np.uint8]) -> Boxes:
        height, width = rgb.shape[:2]
        small = cv2.resize(rgb[..., ::-1], (self._size, self._size), interpolation=cv2.INTER_LINEAR)
        tensor = ((small - self._MEAN) / self._STD).transpose(2, 0, 1)[None].astype(np.float32)
        outputs = self._session.run(None, {self._input: tensor})
        levels = len(outputs) // 2
        parts = []
        for scores, distances, stride in zip(outputs[:levels], outputs[levels:], (8, 16, 32, 64), strict=True):
            keep = scores[0].max(axis=1) >= SCORE_FLOOR
            n = self._size // stride + (self._size % stride > 0)
            index = np.flatnonzero(keep)
            centre = (np.stack([index % n, index // n], axis=1) + 0.5) * stride
            bins = distances[0][keep].reshape(len(index), 4, distances.shape[2] // 4)
            bins = np.exp(bins - bins.max(axis=2, keepdims=True))
            reach = (bins * np.arange(bins.shape[2])).sum(axis=2) / bins.sum(axis=2) * stride
            xyxy = np.concatenate([centre - reach[:, :2], centre + reach[:, 2:]], axis=1)
            table = scores[0][keep].astype(np.float32)
            parts.append(Boxes(xyxy.astype(np.float32), np.where(table < SCORE_FLOOR, np.float32(0), table), COCO))
        boxes = Boxes.concatenate(parts)
        scale = np.array([width, height, width, height], np.float32) / np.float32(self._size)
        return Boxes(boxes.xyxy * scale, boxes.scores, COCO).clipped(width, height)
