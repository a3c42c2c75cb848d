"""``compact`` under ONNX Runtime: a picture in; boxes, masks and vectors out. Needs no PyTorch."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from surveilnav.perception.boxes import Boxes, merged
from surveilnav.perception.detectors.onnx_file import LOWEST

Floats = NDArray[np.float32]

STRIDES = (8, 16, 32)
MASK_STRIDE = 4
#: Boxes that overlap so much are one thing, as for the COCO detectors.
_SAME_THING_IOU = 0.6
#: More boxes than this aren't compared with each other.
_MOST = 300
_GREY = 114


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """All that the network says of one picture at L places.

    ``scores`` (L, C); ``xyxy`` (L, 4) [pixels of the picture]; ``coefficients`` (L, K); ``embeddings`` (L, D);
    ``prototypes`` (K, H / 4, W / 4) of the letterbox; ``image`` (D,); ``near`` (C + R,); ``ratio``: letterbox / picture.
    """

    scores: Floats
    xyxy: Floats
    coefficients: Floats
    embeddings: Floats
    prototypes: Floats
    image: Floats
    near: Floats
    ratio: float

    def mask(self, place: int, box: tuple[float, float, float, float], height: int, width: int) -> NDArray[np.bool_]:
        """(height, width) of the picture: the mask of a place inside a box [pixels]."""
        k, h, w = self.prototypes.shape
        logits = (self.coefficients[place] @ self.prototypes.reshape(k, -1)).reshape(h, w)
        move = np.array([[1, 0, 0], [0, 1, 0]], np.float64) * (MASK_STRIDE / self.ratio)
        move[:, 2] = (MASK_STRIDE / self.ratio - 1) / 2
        whole = cv2.warpAffine(logits.astype(np.float32), move, (width, height), flags=cv2.INTER_LINEAR) > 0
        x0, y0, x1, y1 = (round(v) for v in box)
        inside = np.zeros((height, width), bool)
        inside[max(0, y0) : y1, max(0, x0) : x1] = True
        return np.asarray(whole & inside)


class OnnxCompact:
    """The network in an ONNX file (``export``). ``side_px``: the longer side of what it sees; a multiple of 32."""

    name = "compact"

    def __init__(self, session: onnxruntime.InferenceSession, side_px: int = 416) -> None:
        self._session, self._side = session, side_px
        metadata = session.get_modelmeta().custom_metadata_map
        self.classes: tuple[str, ...] = tuple(json.loads(metadata["classes"]))

    def detect(self, rgb: NDArray[np.uint8]) -> Boxes:
        """Boxes of (height, width, 3) uint8 in its pixels, one a thing, the best first."""
        answer = self.answer(rgb)
        best = answer.scores.max(axis=1)
        keep = np.argsort(-best, kind="stable")[:_MOST]
        keep = keep[best[keep] >= LOWEST]
        scores = np.where(answer.scores[keep] >= LOWEST, answer.scores[keep], np.float32(0.0))
        boxes = Boxes(answer.xyxy[keep], scores, self.classes).clipped(rgb.shape[1], rgb.shape[0])
        return merged(boxes, _SAME_THING_IOU)

    def answer(self, rgb: NDArray[np.uint8]) -> Answer:
        """Everything it says of a picture."""
        box, ratio = letterboxed(rgb, self._side)
        out = dict(zip(self._outputs, self._session.run(self._outputs, {"picture": box[None]}), strict=True))
        points = places(*box.shape[:2])
        ltrb = out["ltrb"]
        xyxy = np.concatenate([points - ltrb[:, :2], points + ltrb[:, 2:]], axis=1) / ratio
        return Answer(
            out["scores"], xyxy.astype(np.float32), out["coefficients"], out["embeddings"], out["prototypes"],
            out["image"], out["near"], ratio,
        )  # fmt: skip

    _outputs = ("scores", "ltrb", "coefficients", "embeddings", "prototypes", "image", "near")


def letterboxed(rgb: NDArray[np.uint8], side_px: int) -> tuple[NDArray[np.uint8], float]:
    """(picture reduced to a longer side of ``side_px`` and filled up to multiples of 32, its scale)."""
    height, width = rgb.shape[:2]
    ratio = side_px / max(height, width)
    size = round(width * ratio), round(height * ratio)
    full = -(-size[1] // 32) * 32, -(-size[0] // 32) * 32
    out = np.full((*full, 3), _GREY, np.uint8)
    out[: size[1], : size[0]] = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA if ratio < 1 else cv2.INTER_LINEAR)
    return out, ratio


@lru_cache(maxsize=8)
def places(height_px: int, width_px: int) -> Floats:
    """(L, 2) centres (x, y) [pixels] of all places, stride 8 first, row by row. Shared: don't write to it."""
    grids = []
    for stride in STRIDES:
        rows, columns = height_px // stride, width_px // stride
        grids.append(
            (np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2) + 0.5) * stride
        )
    return np.concatenate(grids).astype(np.float32)
