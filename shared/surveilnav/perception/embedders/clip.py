"""CLIP (Radford et al. 2021, arXiv 2103.00020), SigLIP (Zhai et al. 2023) and SigLIP 2 (Tschannen et al. 2025).

Pictures and texts as unit vectors of one space: the cosine says how well they fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
import transformers
from numpy.typing import NDArray

from surveilnav.perception.boxes import Boxes
from surveilnav.perception.protocols import ViewEmbedding
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.torch_model import expect_type, image_processor, load, numbers, tokenizer, tokens

MODEL_TYPES = ("clip", "siglip", "siglip2")

_MARGIN = 0.1  # of the longer side, on each side: a thing is easier to tell with a little of what it stands on
_SIGLIP_TOKENS = 64  # its texts were padded to so many in training
_FEW = 64  # pictures at once


class Clip:
    """The embedder of this module. ``model``: the space's id; ``dim``: D of its vectors."""

    def __init__(self, path: Path, model: str, runtime: Runtime | None = None) -> None:
        """Loads a folder of transformers.

        Args:
            path: the folder.
            model: its id.
            runtime: where and how it runs.

        Raises:
            PerceptionError: it can't be loaded.
        """
        self.model, self._type = model, expect_type(path, MODEL_TYPES)
        self._model = load(transformers.AutoModel, path, MODEL_TYPES, runtime or Runtime())
        self._images, self._tokenizer = image_processor(path), tokenizer(path)
        self.dim = int(self.embed_texts(["a room"]).shape[1])

    def embed_views(
        self, images: Sequence[NDArray[np.uint8]], boxes: Sequence[Boxes], rows: Sequence[NDArray[np.int64]]
    ) -> list[ViewEmbedding]:
        """See ``Embedder.embed_views``: all pictures, and squares around their boxes, together."""
        pictures: list[NDArray[np.uint8]] = list(images)
        for image, found, of_image in zip(images, boxes, rows, strict=True):
            pictures += [square(image, xyxy) for xyxy in found.xyxy[of_image]]
        vectors = self._embed(pictures)
        ends = np.cumsum([len(images), *(len(of_image) for of_image in rows)])
        return [ViewEmbedding(vectors[i], vectors[ends[i] : ends[i + 1]]) for i in range(len(images))]

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """See ``Embedder.embed_texts``. What is longer than the model reads is cut."""
        if not texts:
            return np.zeros((0, self.dim), np.float32)
        if self._type == "clip":
            asked = tokens(self._tokenizer, texts)
        else:  # trained on lower case; its padding is read, and not masked
            lower = [text.lower() for text in texts]
            asked = {"input_ids": tokens(self._tokenizer, lower, most=_SIGLIP_TOKENS)["input_ids"]}
        with self._model.running():
            out = self._model.net.get_text_features(**{k: v.to(self._model.device) for k, v in asked.items()})
        return _unit(out)

    def _embed(self, pictures: Sequence[NDArray[np.uint8]]) -> NDArray[np.float32]:
        """(N, D) unit vectors of pictures of any sizes."""
        parts = [np.zeros((0, self.dim), np.float32)]
        for start in range(0, len(pictures), _FEW):
            inputs = self._images(list(pictures[start : start + _FEW]), return_tensors="pt", **self._whole())
            with self._model.running():
                out = self._model.net.get_image_features(**{k: v.to(self._model.device) for k, v in inputs.items()})
            parts.append(_unit(out))
        return np.concatenate(parts)

    def _whole(self) -> dict[str, Any]:
        """CLIP cuts a picture to its middle square, where a view's sides are lost: it is stretched instead, as SigLIP's."""
        if self._type != "clip":
            return {}
        side = int(self._images.crop_size["height"])
        return {"do_center_crop": False, "size": {"height": side, "width": side}}


def _unit(features: Any) -> NDArray[np.float32]:
    """(N, D) unit vectors of what a model says: a tensor, or an output that holds it."""
    vectors = numbers(features if isinstance(features, torch.Tensor) else features.pooler_output)
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12), np.float32)


def square(image: NDArray[np.uint8], xyxy: NDArray[np.float32]) -> NDArray[np.uint8]:
    """The square around a box [pixels], with a margin: the network's input is a square, and a long thing is neither
    stretched nor cut. It is moved into the picture; where the picture is too small, the rest is its mean colour."""
    height, width = image.shape[:2]
    x0, y0, x1, y1 = (float(v) for v in xyxy)
    side = max(2, round(max(x1 - x0, y1 - y0) * (1 + 2 * _MARGIN)))
    left, top = (_start((x0 + x1) / 2, side, width), _start((y0 + y1) / 2, side, height))
    seen = image[max(0, top) : top + side, max(0, left) : left + side]
    if seen.shape[:2] == (side, side):
        return seen
    out = np.empty((side, side, 3), np.uint8)
    out[:] = image.mean(axis=(0, 1)).astype(np.uint8)
    out[max(0, -top) : max(0, -top) + seen.shape[0], max(0, -left) : max(0, -left) + seen.shape[1]] = seen
    return out


def _start(centre_px: float, side: int, size_px: int) -> int:
    """Where a stretch of ``side`` pixels around a centre begins: inside the picture, or in its middle if it is longer."""
    if side >= size_px:
        return (size_px - side) // 2
    return int(np.clip(round(centre_px - side / 2), 0, size_px - side))
