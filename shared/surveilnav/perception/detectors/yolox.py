"""YOLOX on COCO's classes, as an ONNX file."""

from __future__ import annotations

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from surveilnav.perception.boxes import Boxes
from surveilnav.perception.detectors.onnx_file import SCORE_FLOOR
from surveilnav.perception.vocabulary import COCO


class Yolox:
    """YOLOX (Ge et al. 2021), anchor-free with strides 8, 16 and 32.

    Input: the picture letterboxed into the top left corner, BGR 0-255.
    """

    def __init__(self, name: str, session: onnxruntime.InferenceSession) -> None:
        self.name, self._session = name, session
        entry = session.get_inputs()[0]
        self._input, self._size = entry.name, int(entry.shape[2])
        cells, strides = [], []
        for stride in (8, 16, 32):
            n = self._size // stride
            cells.append(np.stack(np.meshgrid(np.arange(n), np.arange(n)), axis=-1).reshape(-1, 2))
            strides.append(np.full(n * n, stride))
        self._cells = np.concatenate(cells).astype(np.float32)
        self._strides = np.concatenate(strides).astype(np.float32)[:, None]

    def detect(self, rgb: NDArray[np.uint8]) -> Boxes:
        height, width = rgb.shape[:2]
        ratio = min(self._size / height, self._size / width)
        inside = round(width * ratio), round(height * ratio)
        canvas = np.full((self._size, self._size, 3), 114, np.uint8)
        canvas[: inside[1], : inside[0]] = cv2.resize(rgb[..., ::-1], inside, interpolation=cv2.INTER_LINEAR)
        tensor = canvas.transpose(2, 0, 1)[None].astype(np.float32)
        out = self._session.run(None, {self._input: tensor})[0][0]
        keep = out[:, 4] >= SCORE_FLOOR
        out, cells, strides = out[keep], self._cells[keep], self._strides[keep]
        scores = out[:, 4:5] * out[:, 5:]
        scores[scores < SCORE_FLOOR] = 0.0
        keep = scores.any(axis=1)
        centre = (out[keep, :2] + cells[keep]) * strides[keep]
        half = np.exp(out[keep, 2:4]) * strides[keep] / 2
        xyxy = np.concatenate([centre - half, centre + half], axis=1) / ratio
        return Boxes(xyxy.astype(np.float32), scores[keep], COCO).clipped(width, height)
