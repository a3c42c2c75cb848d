"""Detectors of COCO's classes as ONNX files, family by family: picture in, boxes with class scores out."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from surveilnav.categories import COCO
from surveilnav.errors import PerceptionError
from surveilnav.perception.boxes import Boxes

#: Weaker scores than this are noise, which adds up over 80 classes and hundreds of boxes.
LOWEST = 0.08
_N = len(COCO)


class Detector(Protocol):
    """Finds things of COCO's classes in a picture."""

    name: str

    def detect(self, rgb: NDArray[np.uint8]) -> Boxes:
        """Boxes of (height, width, 3) uint8, duplicates included, in its pixels."""
        ...


def load(path: Path, family: str, threads: int) -> Detector:
    """The detector in an ONNX file of that family.

    Raises:
        PerceptionError: the file can't be loaded, or the family is unknown.
    """
    kinds: dict[str, Any] = {"yolox": Yolox, "deimv2": Deimv2, "picodet": Picodet}
    if family not in kinds:
        raise PerceptionError(f"expected a family of detectors out of {sorted(kinds)}, got {family!r}")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # idle threads leave the cores to others
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        detector: Detector = kinds[family](path.stem, session)
        return detector
    except Exception as error:  # onnxruntime raises its own kinds, which share no public base
        raise PerceptionError(f"{path.name} can't be loaded as a {family} network: {error}") from error


class Yolox:
    """YOLOX (Ge et al. 2021): letterboxed to the top left, BGR 0-255; anchor-free over strides 8, 16, 32."""

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
        keep = out[:, 4] >= LOWEST
        out, cells, strides = out[keep], self._cells[keep], self._strides[keep]
        scores = out[:, 4:5] * out[:, 5:]
        scores[scores < LOWEST] = 0.0
        keep = scores.any(axis=1)
        centre = (out[keep, :2] + cells[keep]) * strides[keep]
        half = np.exp(out[keep, 2:4]) * strides[keep] / 2
        xyxy = np.concatenate([centre - half, centre + half], axis=1) / ratio
        return Boxes(xyxy.astype(np.float32), scores[keep]).clipped(width, height)


class Deimv2:
    """DEIMv2 (Huang et al. 2025), a DETR: stretched, RGB 0-1; gives labels, boxes and scores of its best queries."""

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
        keep = scores[0] >= LOWEST
        table = np.zeros((int(keep.sum()), _N), np.float32)
        table[np.arange(len(table)), np.clip(labels[0][keep], 0, _N - 1)] = scores[0][keep]
        return Boxes(boxes[0][keep].astype(np.float32), table).clipped(width, height)


class Picodet:
    """PicoDet (Yu et al. 2021): stretched, BGR normalised; per stride class scores and distance distributions."""

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
            keep = scores[0].max(axis=1) >= LOWEST
            n = self._size // stride + (self._size % stride > 0)
            index = np.flatnonzero(keep)
            centre = (np.stack([index % n, index // n], axis=1) + 0.5) * stride
            bins = distances[0][keep].reshape(len(index), 4, distances.shape[2] // 4)
            bins = np.exp(bins - bins.max(axis=2, keepdims=True))
            reach = (bins * np.arange(bins.shape[2])).sum(axis=2) / bins.sum(axis=2) * stride
            xyxy = np.concatenate([centre - reach[:, :2], centre + reach[:, 2:]], axis=1)
            table = scores[0][keep].astype(np.float32)
            parts.append(Boxes(xyxy.astype(np.float32), np.where(table < LOWEST, np.float32(0), table)))
        boxes = Boxes.joined(parts)
        scale = np.array([width, height, width, height], np.float32) / np.float32(self._size)
        return Boxes(boxes.xyxy * scale, boxes.scores).clipped(width, height)
