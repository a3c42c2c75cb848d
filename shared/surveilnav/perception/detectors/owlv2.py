"""OWLv2 (Minderer et al. 2023, arXiv 2306.09683): every patch of a picture is a box, compared with every word's text."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import transformers
from numpy.typing import NDArray

from surveilnav.perception.boxes import Boxes
from surveilnav.perception.detectors.queries import chosen, corners, in_groups, things
from surveilnav.perception.detectors.spans import cleaned
from surveilnav.perception.detectors.word_length import WordLength
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.torch_model import image_processor, load, numbers, tokenizer, tokens

MODEL_TYPES = ("owlv2",)

#: Neighbouring patches find the same thing.
_SAME_THING_IOU = 0.5

_text = "a photo of a {}".format


class Owlv2:
    """The detector of this module. ``vocabulary``: None, it knows any word but those that it refuses (``ChecksWords``)."""

    vocabulary = None

    def __init__(self, path: Path, model: str, runtime: Runtime | None = None, *, threshold: float = 0.1) -> None:
        """Loads a folder of transformers.

        Args:
            path: the folder.
            model: its id.
            runtime: where and how it runs.
            threshold: the score of its best word that a box needs; this network's are low.

        Raises:
            PerceptionError: it can't be loaded.
        """
        self.model, self.threshold = model, threshold
        self._model = load(transformers.Owlv2ForObjectDetection, path, MODEL_TYPES, runtime or Runtime())
        self._images, self._tokenizer = image_processor(path), tokenizer(path)
        self._most_tokens = int(self._model.net.config.text_config.max_position_embeddings)
        self.refusal = WordLength(path, self._most_tokens, _text).refusal

    def detect(self, images: Sequence[NDArray[np.uint8]], words: Sequence[Sequence[str]]) -> list[Boxes]:
        """See ``Detector.detect``. Pictures of one size that are asked for the same words run as one batch."""
        return in_groups(images, words, self._detect, self.refusal)

    def _detect(self, images: Sequence[NDArray[np.uint8]], words: tuple[str, ...]) -> list[Boxes]:
        asked = tokens(self._tokenizer, [_text(cleaned(word)) for word in words], most=self._most_tokens, whole=True)
        inputs = {name: tensor.repeat(len(images), 1).to(self._model.device) for name, tensor in asked.items()}
        pixels = self._images(list(images), return_tensors="pt")["pixel_values"].to(self._model.device)
        with self._model.running():
            out = self._model.net(pixel_values=pixels, **inputs)
        height, width = images[0].shape[:2]
        side = max(height, width)  # the picture was padded to a square on the right and below
        return [
            things([chosen(corners(cxcywh, side, side), scores, words, self.threshold)], _SAME_THING_IOU, width, height)
            for cxcywh, scores in zip(numbers(out.pred_boxes), numbers(out.logits.sigmoid()), strict=True)
        ]
