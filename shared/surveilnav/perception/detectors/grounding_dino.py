"""Grounding DINO (Liu et al. 2023, arXiv 2303.05499) and MM-Grounding-DINO (Zhao et al. 2024, arXiv 2401.02361).

A picture and a text look at each other; 900 queries give a box each, and how well every token of the text fits it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import transformers
from numpy.typing import NDArray

from surveilnav.perception.boxes import Boxes
from surveilnav.perception.detectors.queries import chosen, corners, in_groups, things
from surveilnav.perception.detectors.spans import Marks, Prompt, cleaned, prompts, word_scores
from surveilnav.perception.detectors.word_length import WordLength
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.torch_model import image_processor, load, numbers, tokenizer

MODEL_TYPES = ("grounding-dino", "mm-grounding-dino")

#: Boxes of one thing overlap so much. The network needs no suppression of its own, but its passes don't know each other.
_SAME_THING_IOU = 0.8


class GroundingDino:
    """The detector of this module. ``vocabulary``: None, it knows any word but those that it refuses (``ChecksWords``)."""

    vocabulary = None

    def __init__(
        self,
        path: Path,
        model: str,
        runtime: Runtime | None = None,
        *,
        threshold: float = 0.3,
        text_threshold: float = 0.25,
        words_per_pass: int = 0,
    ) -> None:
        """Loads a folder of transformers.

        Args:
            path: the folder.
            model: its id.
            runtime: where and how it runs.
            threshold: the score of its best word that a box needs.
            text_threshold: other words of a box with less count as not said.
            words_per_pass: how many words one text holds; 0: as many as fit.

        Raises:
            PerceptionError: it can't be loaded.
        """
        self.model, self.threshold, self.text_threshold = model, threshold, text_threshold
        self.words_per_pass = words_per_pass
        self._model = load(transformers.AutoModelForZeroShotObjectDetection, path, MODEL_TYPES, runtime or Runtime())
        self._most_tokens = int(self._model.net.config.max_text_len)
        self._images, self._tokenizer = image_processor(path), tokenizer(path)
        self.refusal = WordLength(path, self._most_tokens, "{}.".format).refusal
        start, stop, dot, question = self._tokenizer.convert_tokens_to_ids(["[CLS]", "[SEP]", ".", "?"])
        self._marks = Marks(start, stop, dot, inside=(question,))

    def detect(self, images: Sequence[NDArray[np.uint8]], words: Sequence[Sequence[str]]) -> list[Boxes]:
        """See ``Detector.detect``. Pictures of one size that are asked for the same words run as one batch."""
        return in_groups(images, words, self._detect, self.refusal)

    def _detect(self, images: Sequence[NDArray[np.uint8]], words: tuple[str, ...]) -> list[Boxes]:
        pixels = self._images(list(images), return_tensors="np")["pixel_values"]
        height, width = images[0].shape[:2]
        parts: list[list[Boxes]] = [[] for _ in images]
        for prompt in self.prompts(words):
            for row, (cxcywh, logits) in enumerate(self._pass(pixels, prompt)):
                scores = word_scores(logits, prompt, len(words))
                xyxy = corners(cxcywh, width, height)
                parts[row].append(chosen(xyxy, scores, words, self.threshold, self.text_threshold))
        return [things(of_one, _SAME_THING_IOU, width, height) for of_one in parts]

    def prompts(self, words: Sequence[str]) -> list[Prompt]:
        """The texts in which these words are looked for.

        Raises:
            PerceptionError: a word names nothing, or is too long.
        """
        tokens = [self._tokenizer(cleaned(word), add_special_tokens=False)["input_ids"] for word in words]
        return prompts(tokens, self._marks, self._most_tokens, self.words_per_pass)

    def _pass(
        self, pixels: NDArray[np.float32], prompt: Prompt
    ) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        """Of each picture (Q, 4) centres and sizes of boxes in shares of its sides, and logits (Q, tokens)."""
        ids = np.repeat(prompt.ids[None], len(pixels), axis=0)
        with self._model.running():
            out = self._model.net(pixel_values=self._model.tensor(pixels), input_ids=self._model.tensor(ids))
        return list(zip(numbers(out.pred_boxes), numbers(out.logits), strict=True))
