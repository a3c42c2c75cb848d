"""Grounding DINO (Liu et al. 2023, arXiv 2303.05499) and MM-Grounding-DINO (Zhao et al. 2024, arXiv 2401.02361).

A picture and a text look at each other; 900 queries give a box each, and how well every token of the text fits it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import transformers
from numpy.typing import NDArray

from surveilnav.perception.boxes import Boxes, merged
from surveilnav.perception.detectors.spans import Marks, Prompt, cleaned, prompts, word_scores
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.torch_model import groups, image_processor, load, numbers, part

MODEL_TYPES = ("grounding-dino", "mm-grounding-dino")

#: Boxes of one thing overlap so much. The network needs no suppression of its own, but its passes don't know each other.
_SAME_THING_IOU = 0.8


class GroundingDino:
    """The detector of this module. ``vocabulary``: None, it knows any word."""

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
        self._images, self._tokenizer = image_processor(path), part(transformers.AutoTokenizer, path)
        start, stop, dot, question = self._tokenizer.convert_tokens_to_ids(["[CLS]", "[SEP]", ".", "?"])
        self._marks = Marks(start, stop, dot, inside=(question,))

    def detect(self, images: Sequence[NDArray[np.uint8]], words: Sequence[Sequence[str]]) -> list[Boxes]:
        """See ``Detector.detect``. Pictures of one size that are asked for the same words run as one batch."""
        found = [Boxes.empty(tuple(w)) for w in words]
        keys = ((image.shape, tuple(w)) for image, w in zip(images, words, strict=True))
        for rows in groups(keys):
            if found[rows[0]].words:
                for row, boxes in zip(rows, self._detect([images[i] for i in rows], words[rows[0]]), strict=True):
                    found[row] = boxes
        return found

    def _detect(self, images: Sequence[NDArray[np.uint8]], words: Sequence[str]) -> list[Boxes]:
        """Boxes of pictures of one size, all asked for the same words."""
        pixels = self._images(list(images), return_tensors="np")["pixel_values"]
        passes = [self._pass(pixels, prompt) for prompt in self.prompts(words)]
        height, width = images[0].shape[:2]
        found = []
        for i in range(len(images)):
            parts = [
                self._boxes(cxcywh[i], logits[i], prompt, words, width, height) for prompt, cxcywh, logits in passes
            ]
            found.append(merged(Boxes.joined(parts), _SAME_THING_IOU).clipped(width, height))
        return found

    def prompts(self, words: Sequence[str]) -> list[Prompt]:
        """The texts in which these words are looked for."""
        tokens = [self._tokenizer(cleaned(word), add_special_tokens=False)["input_ids"] for word in words]
        return prompts(tokens, self._marks, self._most_tokens, self.words_per_pass)

    def _pass(
        self, pixels: NDArray[np.float32], prompt: Prompt
    ) -> tuple[Prompt, NDArray[np.float32], NDArray[np.float32]]:
        """(prompt, boxes (B, Q, 4) as centre and size in shares of the picture, logits (B, Q, tokens))."""
        ids = np.repeat(prompt.ids[None], len(pixels), axis=0)
        with self._model.running():
            out = self._model.net(pixel_values=self._model.tensor(pixels), input_ids=self._model.tensor(ids))
        return prompt, numbers(out.pred_boxes), numbers(out.logits)

    def _boxes(
        self,
        cxcywh: NDArray[np.float32],
        logits: NDArray[np.float32],
        prompt: Prompt,
        words: Sequence[str],
        width_px: int,
        height_px: int,
    ) -> Boxes:
        """Of one picture and one pass, those above the thresholds, in pixels."""
        scores = word_scores(logits, prompt, len(words))
        keep = scores.max(axis=1) >= self.threshold
        scores = np.where(scores >= self.text_threshold, scores, 0.0).astype(np.float32)
        return Boxes(corners(cxcywh[keep], width_px, height_px), scores[keep], tuple(words))


def corners(cxcywh: NDArray[np.float32], width_px: float, height_px: float) -> NDArray[np.float32]:
    """Boxes (N, 4) xyxy [pixels] of centres and sizes in shares of a picture's sides."""
    centre, half = cxcywh[:, :2], cxcywh[:, 2:] / 2
    scale = np.array([width_px, height_px] * 2, np.float32)
    return np.asarray(np.concatenate([centre - half, centre + half], axis=1) * scale, np.float32)
