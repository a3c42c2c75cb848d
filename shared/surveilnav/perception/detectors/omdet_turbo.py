"""OmDet-Turbo (Zhao et al. 2024, arXiv 2403.06892): every word is a text of its own, and is compared with 900 queries.

The published weights have a Swin backbone of timm: they need that package too.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
import transformers
from numpy.typing import NDArray

from surveilnav.perception.boxes import Boxes
from surveilnav.perception.detectors.queries import chosen, corners, in_groups, things
from surveilnav.perception.detectors.spans import cleaned
from surveilnav.perception.detectors.word_length import WordLength
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.torch_model import image_processor, load, numbers, tokenizer, tokens

MODEL_TYPES = ("omdet-turbo",)

_SAME_THING_IOU = 0.5  # the paper's
_MOST_TOKENS = 77  # of a text, in training


class OmDetTurbo:
    """The detector of this module. ``vocabulary``: None, it knows any word but those that it refuses (``ChecksWords``)."""

    vocabulary = None

    def __init__(self, path: Path, model: str, runtime: Runtime | None = None, *, threshold: float = 0.3) -> None:
        """Loads a folder of transformers.

        Args:
            path: the folder.
            model: its id.
            runtime: where and how it runs.
            threshold: the score of its best word that a box needs.

        Raises:
            PerceptionError: it can't be loaded.
        """
        self.model, self.threshold = model, threshold
        self._model = load(transformers.OmDetTurboForObjectDetection, path, MODEL_TYPES, runtime or Runtime())
        self._images, self._tokenizer = image_processor(path), tokenizer(path)
        self.refusal = WordLength(path, _MOST_TOKENS).refusal

    def detect(self, images: Sequence[NDArray[np.uint8]], words: Sequence[Sequence[str]]) -> list[Boxes]:
        """See ``Detector.detect``. Pictures of one size that are asked for the same words run as one batch."""
        return in_groups(images, words, self._detect, self.refusal)

    def _detect(self, images: Sequence[NDArray[np.uint8]], words: tuple[str, ...]) -> list[Boxes]:
        clean = [cleaned(word) for word in words]
        n = len(images)
        task, classes = (
            tokens(self._tokenizer, [f"Detect {', '.join(clean)}."]),
            tokens(self._tokenizer, clean, most=_MOST_TOKENS, whole=True),
        )
        pixels = self._images(list(images), return_tensors="pt")["pixel_values"]
        inputs = {
            "pixel_values": pixels,
            "classes_input_ids": classes["input_ids"].repeat(n, 1),
            "classes_attention_mask": classes["attention_mask"].repeat(n, 1),
            "tasks_input_ids": task["input_ids"].repeat(n, 1),
            "tasks_attention_mask": task["attention_mask"].repeat(n, 1),
            "classes_structure": torch.full((n,), len(words)),
        }
        with self._model.running():
            out = self._model.net(**{name: tensor.to(self._model.device) for name, tensor in inputs.items()})
        every = zip(numbers(out.decoder_coord_logits), numbers(out.decoder_class_logits.sigmoid()), strict=True)
        height, width = images[0].shape[:2]
        return [
            things(
                [chosen(corners(cxcywh, width, height), scores, words, self.threshold)], _SAME_THING_IOU, width, height
            )
            for cxcywh, scores in every
        ]
