"""SAM 2 and 2.1 (Ravi et al. 2024, arXiv 2408.00714) on single pictures, with boxes as prompts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
import transformers
from numpy.typing import NDArray

from surveilnav.perception.protocols import RgbdView
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.segmenters.box_prompts import Masks, crop_to_box, normalized_pixels
from surveilnav.perception.torch_model import load_model, to_numpy

#: The published folders contain the video tracker, of which the model for single pictures is a part.
MODEL_TYPES = ("sam2", "sam2_video")


class Sam2:
    """A ``Segmenter``."""

    def __init__(self, path: Path, model: str, runtime: Runtime | None = None) -> None:
        """``path``: a folder in the format of transformers. PerceptionError: it can't be loaded."""
        self.model = model
        self._model = load_model(transformers.Sam2Model, path, MODEL_TYPES, runtime or Runtime())
        self._side = int(self._model.net.config.prompt_encoder_config.image_size)

    def segment(self, views: Sequence[RgbdView], boxes: Sequence[NDArray[np.float32]]) -> list[Masks]:
        """See ``Segmenter.segment``. All pictures are encoded as one batch, then the boxes of each are decoded as one."""
        rows = [row for row, xyxy in enumerate(boxes) if len(xyxy)]
        masks: list[Masks] = [[] for _ in views]
        if not rows:
            return masks
        batch = np.stack([normalized_pixels(views[row].rgb, self._side, self._side) for row in rows])
        with self._model.running():
            features = self._model.net.get_image_embeddings(self._model.tensor(batch))
            for i, row in enumerate(rows):
                masks[row] = self._decode([level[i : i + 1] for level in features], views[row].rgb.shape, boxes[row])
        return masks

    def _decode(self, features: list[torch.Tensor], shape: tuple[int, ...], xyxy: NDArray[np.float32]) -> Masks:
        """Masks of the boxes (N, 4) [pixels] of one picture (height, width, 3)."""
        height, width = shape[:2]
        scale = np.array([self._side / width, self._side / height] * 2, np.float32)
        prompts = self._model.tensor((xyxy * scale)[None].astype(np.float32))
        out = self._model.net(image_embeddings=features, input_boxes=prompts, multimask_output=False)
        return [
            crop_to_box(_enlarged(logits, height, width) > 0, box)
            for logits, box in zip(out.pred_masks[0], xyxy, strict=True)
        ]


def _enlarged(logits: torch.Tensor, height_px: int, width_px: int) -> NDArray[np.float32]:
    """Logits (1, h, w) enlarged to (height, width). One at a time: a hundred in a camera's resolution would fill the memory."""
    size = (height_px, width_px)
    return to_numpy(
        torch.nn.functional.interpolate(logits[None].float(), size, mode="bilinear", align_corners=False)[0, 0]
    )
