"""CLIP (Radford et al. 2021, arXiv 2103.00020), SigLIP (Zhai et al. 2023) and SigLIP 2 (Tschannen et al. 2025).

They turn pictures and texts into unit vectors of one space, whose cosine measures how well they fit.
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
from surveilnav.perception.torch_model import (
    check_model_type,
    load_image_processor,
    load_model,
    load_tokenizer,
    to_numpy,
    tokenize,
)

MODEL_TYPES = ("clip", "siglip", "siglip2")

_MARGIN = 0.1  # around an object's box, as a share of its longer side: some surroundings help to recognise it
_SIGLIP_TOKENS = 64  # length to which texts were padded in training
_BATCH = 64


class Clip:
    """An ``Embedder`` of pictures, objects and texts with a CLIP, SigLIP or SigLIP 2 model in PyTorch (transformers)."""

    def __init__(self, path: Path, model: str, runtime: Runtime | None = None) -> None:
        """``path``: a folder in the format of transformers. PerceptionError: it can't be loaded."""
        self.model, self._type = model, check_model_type(path, MODEL_TYPES)
        self._model = load_model(transformers.AutoModel, path, MODEL_TYPES, runtime or Runtime())
        self._images, self._tokenizer = load_image_processor(path), load_tokenizer(path)
        self.dim = int(self.embed_texts(["a room"]).shape[1])

    def embed_views(
        self, images: Sequence[NDArray[np.uint8]], boxes: Sequence[Boxes], rows: Sequence[NDArray[np.int64]]
    ) -> list[ViewEmbedding]:
        """See ``Embedder.embed_views``. All pictures, and the squares around their boxes, run together in batches."""
        pictures: list[NDArray[np.uint8]] = list(images)
        for image, found, of_image in zip(images, boxes, rows, strict=True):
            pictures += [crop_square(image, xyxy) for xyxy in found.xyxy[of_image]]
        vectors = self._embed(pictures)
        ends = np.cumsum([len(images), *(len(of_image) for of_image in rows)])
        return [ViewEmbedding(vectors[i], vectors[ends[i] : ends[i + 1]]) for i in range(len(images))]

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """See ``Embedder.embed_texts``. Texts that are too long for the model are cut."""
        if not texts:
            return np.zeros((0, self.dim), np.float32)
        if self._type == "clip":
            inputs = tokenize(self._tokenizer, texts)
        else:  # SigLIP was trained on lower case, and with padding that isn't masked
            lower = [text.lower() for text in texts]
            inputs = {"input_ids": tokenize(self._tokenizer, lower, max_tokens=_SIGLIP_TOKENS)["input_ids"]}
        with self._model.running():
            out = self._model.net.get_text_features(**{k: v.to(self._model.device) for k, v in inputs.items()})
        return _unit(out)

    def _embed(self, pictures: Sequence[NDArray[np.uint8]]) -> NDArray[np.float32]:
        """Unit vectors (N, D) of pictures of any sizes."""
        parts = [np.zeros((0, self.dim), np.float32)]
        for start in range(0, len(pictures), _BATCH):
            inputs = self._images(
                list(pictures[start : start + _BATCH]), return_tensors="pt", **self._processor_options()
            )
            with self._model.running():
                out = self._model.net.get_image_features(**{k: v.to(self._model.device) for k, v in inputs.items()})
            parts.append(_unit(out))
        return np.concatenate(parts)

    def _processor_options(self) -> dict[str, Any]:
        """By default CLIP crops a picture to its central square, which loses the sides of a view. It is stretched instead."""
        if self._type != "clip":
            return {}
        side = int(self._images.crop_size["height"])
        return {"do_center_crop": False, "size": {"height": side, "width": side}}


def _unit(features: Any) -> NDArray[np.float32]:
    """Unit vectors (N, D) of a model's features: a tensor, or an output that contains it."""
    vectors = to_numpy(features if isinstance(features, torch.Tensor) else features.pooler_output)
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12), np.float32)


def crop_square(image: NDArray[np.uint8], xyxy: NDArray[np.float32]) -> NDArray[np.uint8]:
    """The square around a box [pixels] with a margin, which neither stretches nor cuts a long object.

    The square is moved into the picture. If the picture is too small, the rest is filled with its mean colour.
    """
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
    """Start of an interval of ``side`` pixels around a centre, moved into ``size_px``; centred if it is longer than that."""
    if side >= size_px:
        return (size_px - side) // 2
    return int(np.clip(round(centre_px - side / 2), 0, size_px - side))
