"""YOLO-World (Cheng et al. 2024, arXiv 2401.17270) from a user's ONNX file, for the words that it was exported with.

Two layouts are supported, those of the usual exporters: one output (1, 4 + W, N) with boxes (centre and size in pixels of the
input) and word scores; or four outputs ``num_dets``, ``boxes`` (corners), ``scores`` and ``labels`` after non-maximum
suppression. The words are read from the file's metadata (``names``), else from a text file beside it with one word per line.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from surveilnav.errors import PerceptionError
from surveilnav.perception.boxes import Boxes, merge_overlapping
from surveilnav.perception.detectors.onnx_file import SCORE_FLOOR, open_session
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.vocabulary import Vocabulary
from surveilnav.words import canonical

_PADDING = 114  # grey, as in training
_SAME_THING_IOU = 0.7  # as in its own non-maximum suppression


class YoloWorld:
    """The detector in one file. Scores below ``threshold`` are set to zero.

    Raises:
        PerceptionError: the file is no YOLO-World network, or its words can't be found.
    """

    def __init__(
        self, path: Path, model: str, runtime: Runtime | None = None, *, threshold: float = SCORE_FLOOR
    ) -> None:
        self.model, self._path, self._threshold = model, path, threshold
        self._session = open_session(path, runtime or Runtime())
        entry = self._session.get_inputs()[0]
        if len(entry.shape) != 4 or not all(isinstance(n, int) for n in entry.shape[1:]) or entry.shape[1] != 3:
            raise PerceptionError(
                f"{path.name}: expected an input of (1, 3, height, width) with fixed sizes, got {entry.shape}"
            )
        self._input, (self._height, self._width) = entry.name, entry.shape[2:]
        self._outputs = [output.name for output in self._session.get_outputs()]
        self.vocabulary = Vocabulary(path.stem, exported_words(path, self._session))

    def detect(self, images: Sequence[NDArray[np.uint8]], words: Sequence[Sequence[str]] = ()) -> list[Boxes]:
        """See ``Detector.detect``. Pictures are processed one by one, because the file has a batch size of 1."""
        return [self._detect(rgb) for rgb in images]

    def _detect(self, rgb: NDArray[np.uint8]) -> Boxes:
        tensor, ratio, left, top = letterboxed(rgb, self._width, self._height)
        out = [np.asarray(o) for o in self._session.run(None, {self._input: tensor})]
        found = (
            self._boxes_of_one_output(out[0])
            if len(out) == 1
            else self._boxes_of_four_outputs(dict(zip(self._outputs, out, strict=True)))
        )
        xyxy = (found.xyxy - np.array([left, top, left, top], np.float32)) / np.float32(ratio)
        return merge_overlapping(
            Boxes(xyxy, found.scores, found.words).clipped(rgb.shape[1], rgb.shape[0]), _SAME_THING_IOU
        )

    def _boxes_of_one_output(self, output: NDArray[Any]) -> Boxes:
        """The boxes in one output (1, 4 + W, N), or (1, N, 4 + W)."""
        n = 4 + len(self.vocabulary)
        table = output[0] if output.ndim == 3 else output
        table = table.T if table.shape[0] == n else table
        if table.ndim != 2 or table.shape[1] != n:
            raise PerceptionError(
                f"{self._path.name}: expected boxes and scores of {len(self.vocabulary)} words, got {output.shape}"
            )
        scores = np.where(table[:, 4:] < self._threshold, 0.0, table[:, 4:]).astype(np.float32)
        table, scores = table[scores.any(axis=1)], scores[scores.any(axis=1)]
        half = table[:, 2:4] / 2
        xyxy = np.concatenate([table[:, :2] - half, table[:, :2] + half], axis=1).astype(np.float32)
        return Boxes(xyxy, scores, self.vocabulary)

    def _boxes_of_four_outputs(self, out: dict[str, NDArray[Any]]) -> Boxes:
        """The boxes in the four outputs after suppression."""
        if missing := {"num_dets", "boxes", "scores", "labels"} - set(out):
            raise PerceptionError(f"{self._path.name}: expected the outputs {sorted(missing)}, got {sorted(out)}")
        n = int(out["num_dets"].ravel()[0])
        labels, scores = out["labels"][0][:n].astype(int), out["scores"][0][:n]
        keep = (scores >= self._threshold) & (labels >= 0) & (labels < len(self.vocabulary))
        table = np.zeros((int(keep.sum()), len(self.vocabulary)), np.float32)
        table[np.arange(len(table)), labels[keep]] = scores[keep]
        return Boxes(out["boxes"][0][:n][keep].astype(np.float32), table, self.vocabulary)


def letterboxed(
    rgb: NDArray[np.uint8], width_px: int, height_px: int
) -> tuple[NDArray[np.float32], float, float, float]:
    """A picture scaled into the centre of a grey canvas.

    Returns:
        The network's input (1, 3, height, width), RGB 0-1; the scale; and the picture's left and top edge in it [pixels].
    """
    ratio = min(width_px / rgb.shape[1], height_px / rgb.shape[0])
    size = round(rgb.shape[1] * ratio), round(rgb.shape[0] * ratio)
    left, top = (width_px - size[0]) // 2, (height_px - size[1]) // 2
    canvas = np.full((height_px, width_px, 3), _PADDING, np.uint8)
    canvas[top : top + size[1], left : left + size[0]] = cv2.resize(rgb, size, interpolation=cv2.INTER_LINEAR)
    return canvas.transpose(2, 0, 1)[None].astype(np.float32) / np.float32(255), ratio, float(left), float(top)


def exported_words(path: Path, opened: onnxruntime.InferenceSession) -> list[str]:
    """The words that a file was exported with, in the order of its classes.

    Raises:
        PerceptionError: neither the file nor a text file beside it lists them, one is empty, or one occurs twice.
    """
    metadata = opened.get_modelmeta().custom_metadata_map.get("names", "")
    beside = path.with_suffix(".txt")
    try:
        named = ast.literal_eval(metadata) if metadata else beside.read_text(encoding="utf-8").rstrip().splitlines()
        names = [str(named[i]) for i in range(len(named))] if isinstance(named, dict) else [str(name) for name in named]
    except (OSError, ValueError, SyntaxError, KeyError, TypeError) as error:
        raise PerceptionError(
            f"{path.name} doesn't say which words it was exported with: expected metadata called names, or {beside.name} "
            f"beside it with a word a line ({error})"
        ) from error
    if empty := [
        place for place, name in enumerate(names) if not name.strip()
    ]:  # without it, all classes after it would be named wrongly
        raise PerceptionError(f"the words of {path.name} hold an empty one at place {empty[0]}: name each class")
    words = [canonical(name) for name in names]
    if len(set(words)) != len(words) or not words:
        raise PerceptionError(f"the words of {path.name} must be one or more, each once; they are {words[:20]}")
    return words
