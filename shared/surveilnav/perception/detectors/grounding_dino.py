"""Grounding DINO (Liu et al. 2023, arXiv 2303.05499) and MM-Grounding-DINO (Zhao et al. 2024, arXiv 2401.02361).

The network combines a picture and a text by cross-attention. Each of its 900 queries outputs a box, and how well each token
of the text fits it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import transformers
from numpy.typing import NDArray

from surveilnav.perception.boxes import Boxes
from surveilnav.perception.detectors.queries import detect_in_groups, merge_queries, select_queries, to_corners
from surveilnav.perception.detectors.spans import Prompt, SpecialTokens, build_prompts, clean_word, word_scores
from surveilnav.perception.detectors.word_length import WordLengthCheck
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.torch_model import load_image_processor, load_model, load_tokenizer, to_numpy

MODEL_TYPES = ("grounding-dino", "mm-grounding-dino")

#: Boxes with at least this IoU are one object. One pass gives no duplicates, but different passes may find the same object.
_SAME_THING_IOU = 0.8


class GroundingDino:
    """A ``Detector`` with an open vocabulary, which still refuses some words (``ChecksWords``)."""

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
        """``path``: a folder in the format of transformers. PerceptionError: it can't be loaded.

        Args:
            threshold: the score of its best word that a box needs.
            text_threshold: a box's scores for other words below this are set to zero.
            words_per_pass: number of words in one text; 0: as many as fit.
        """
        self.model, self.threshold, self.text_threshold = model, threshold, text_threshold
        self.words_per_pass = words_per_pass
        self._model = load_model(
            transformers.AutoModelForZeroShotObjectDetection, path, MODEL_TYPES, runtime or Runtime()
        )
        self._max_tokens = int(self._model.net.config.max_text_len)
        self._images, self._tokenizer = load_image_processor(path), load_tokenizer(path)
        self.refusal = WordLengthCheck(path, self._max_tokens, "{}.".format).refusal
        start, stop, dot, question = self._tokenizer.convert_tokens_to_ids(["[CLS]", "[SEP]", ".", "?"])
        self._special = SpecialTokens(start, stop, dot, separators=(question,))

    def detect(self, images: Sequence[NDArray[np.uint8]], words: Sequence[Sequence[str]]) -> list[Boxes]:
        """See ``Detector.detect``. Pictures of the same size with the same words run as one batch."""
        return detect_in_groups(images, words, self._detect, self.refusal)

    def _detect(self, images: Sequence[NDArray[np.uint8]], words: tuple[str, ...]) -> list[Boxes]:
        pixels = self._images(list(images), return_tensors="np")["pixel_values"]
        height, width = images[0].shape[:2]
        parts: list[list[Boxes]] = [[] for _ in images]
        for prompt in self.prompts(words):
            for row, (cxcywh, logits) in enumerate(self._pass(pixels, prompt)):
                scores = word_scores(logits, prompt, len(words))
                xyxy = to_corners(cxcywh, width, height)
                parts[row].append(select_queries(xyxy, scores, words, self.threshold, self.text_threshold))
        return [merge_queries(of_one, _SAME_THING_IOU, width, height) for of_one in parts]

    def prompts(self, words: Sequence[str]) -> list[Prompt]:
        """The texts that look for these words, one for each pass.

        Raises:
            PerceptionError: a word has no letters or digits, or is too long.
        """
        tokens = [self._tokenizer(clean_word(word), add_special_tokens=False)["input_ids"] for word in words]
        return build_prompts(tokens, self._special, self._max_tokens, self.words_per_pass)

    def _pass(
        self, pixels: NDArray[np.float32], prompt: Prompt
    ) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        """For each picture, boxes (Q, 4) as centre and size in shares of its sides, and logits (Q, tokens)."""
        ids = np.repeat(prompt.ids[None], len(pixels), axis=0)
        with self._model.running():
            out = self._model.net(pixel_values=self._model.tensor(pixels), input_ids=self._model.tensor(ids))
        return list(zip(to_numpy(out.pred_boxes), to_numpy(out.logits), strict=True))
