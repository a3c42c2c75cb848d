"""OWLv2 (Minderer et al. 2023, arXiv 2306.09683). Each patch of a picture predicts a box, compared with each word's text."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import transformers
from numpy.typing import NDArray

from surveilnav.perception.boxes import Boxes
from surveilnav.perception.detectors.queries import detect_in_groups, merge_queries, select_queries, to_corners
from surveilnav.perception.detectors.spans import clean_word
from surveilnav.perception.detectors.word_length import WordLengthCheck
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.torch_model import load_image_processor, load_model, load_tokenizer, to_numpy, tokenize

MODEL_TYPES = ("owlv2",)

#: Boxes with at least this IoU are one object: neighbouring patches find the same one.
_SAME_THING_IOU = 0.5

_text = "a photo of a {}".format


class Owlv2:
    """A ``Detector`` with an open vocabulary, which still refuses some words (``ChecksWords``)."""

    vocabulary = None

    def __init__(self, path: Path, model: str, runtime: Runtime | None = None, *, threshold: float = 0.1) -> None:
        """``path``: a folder in the format of transformers. PerceptionError: it can't be loaded.

        ``threshold``: the score of its best word that a box needs; the scores of this network are low.
        """
        self.model, self.threshold = model, threshold
        self._model = load_model(transformers.Owlv2ForObjectDetection, path, MODEL_TYPES, runtime or Runtime())
        self._images, self._tokenizer = load_image_processor(path), load_tokenizer(path)
        self._max_tokens = int(self._model.net.config.text_config.max_position_embeddings)
        self.refusal = WordLengthCheck(path, self._max_tokens, _text).refusal

    def detect(self, images: Sequence[NDArray[np.uint8]], words: Sequence[Sequence[str]]) -> list[Boxes]:
        """See ``Detector.detect``. Pictures of the same size with the same words run as one batch."""
        return detect_in_groups(images, words, self._detect, self.refusal)

    def _detect(self, images: Sequence[NDArray[np.uint8]], words: tuple[str, ...]) -> list[Boxes]:
        text = tokenize(
            self._tokenizer, [_text(clean_word(word)) for word in words], max_tokens=self._max_tokens, refuse_long=True
        )
        inputs = {name: tensor.repeat(len(images), 1).to(self._model.device) for name, tensor in text.items()}
        pixels = self._images(list(images), return_tensors="pt")["pixel_values"].to(self._model.device)
        with self._model.running():
            out = self._model.net(pixel_values=pixels, **inputs)
        height, width = images[0].shape[:2]
        side = max(height, width)  # the picture was padded to a square on the right and below
        return [
            merge_queries(
                [select_queries(to_corners(cxcywh, side, side), scores, words, self.threshold)],
                _SAME_THING_IOU,
                width,
                height,
            )
            for cxcywh, scores in zip(to_numpy(out.pred_boxes), to_numpy(out.logits.sigmoid()), strict=True)
        ]
