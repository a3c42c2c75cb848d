"""OmDet-Turbo (Zhao et al. 2024, arXiv 2403.06892). Each word is a text of its own, and is compared with 900 queries.

The published weights have a Swin backbone of the package timm, which must be installed, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
import transformers
from numpy.typing import NDArray

from surveilnav.perception.boxes import Boxes
from surveilnav.perception.detectors.queries import detect_in_groups, merge_queries, select_queries, to_corners
from surveilnav.perception.detectors.spans import clean_word
from surveilnav.perception.detectors.word_length import WordLengthCheck
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.torch_model import load_image_processor, load_model, load_tokenizer, to_numpy, tokenize

MODEL_TYPES = ("omdet-turbo",)

_SAME_THING_IOU = 0.5  # the paper's
_MAX_TOKENS = 77  # length of a text in training


class OmDetTurbo:
    """A ``Detector`` that looks for any words, except those longer than the texts that it was trained with.

    For these, ``refusal`` says why (``ChecksWords``).
    """

    vocabulary = None

    def __init__(self, path: Path, model: str, runtime: Runtime | None = None, *, threshold: float = 0.3) -> None:
        """``path``: a folder in the format of transformers. PerceptionError: it can't be loaded.

        ``threshold``: the score of its best word that a box needs.
        """
        self.model, self.threshold = model, threshold
        self._model = load_model(transformers.OmDetTurboForObjectDetection, path, MODEL_TYPES, runtime or Runtime())
        self._images, self._tokenizer = load_image_processor(path), load_tokenizer(path)
        self.refusal = WordLengthCheck(path, _MAX_TOKENS).refusal

    def detect(self, images: Sequence[NDArray[np.uint8]], words: Sequence[Sequence[str]]) -> list[Boxes]:
        """See ``Detector.detect``. Pictures of the same size with the same words run as one batch."""
        return detect_in_groups(images, words, self._detect, self.refusal)

    def _detect(self, images: Sequence[NDArray[np.uint8]], words: tuple[str, ...]) -> list[Boxes]:
        clean = [clean_word(word) for word in words]
        n = len(images)
        task, classes = (
            tokenize(self._tokenizer, [f"Detect {', '.join(clean)}."]),
            tokenize(self._tokenizer, clean, max_tokens=_MAX_TOKENS, refuse_long=True),
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
        results = zip(to_numpy(out.decoder_coord_logits), to_numpy(out.decoder_class_logits.sigmoid()), strict=True)
        height, width = images[0].shape[:2]
        return [
            merge_queries(
                [select_queries(to_corners(cxcywh, width, height), scores, words, self.threshold)],
                _SAME_THING_IOU,
                width,
                height,
            )
            for cxcywh, scores in results
        ]
