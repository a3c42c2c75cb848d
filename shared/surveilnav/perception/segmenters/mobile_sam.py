"""MobileSAM (Zhang et al. 2023, arXiv 2306.14289): SAM with a small image encoder.

It runs from its checkpoint ``mobile_sam.pt``, which needs the extra ``mobile-sam``, or from a folder with two ONNX files:
``encoder.onnx`` (pictures to embeddings) and ``decoder.onnx`` (embeddings and points to masks). docs/use/models.md shows
how to export them. Both ways have the same inputs and outputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import PerceptionError
from surveilnav.perception.detectors.onnx_file import open_session
from surveilnav.perception.protocols import RgbdView
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.segmenters import MISSING_PACKAGES
from surveilnav.perception.segmenters.box_prompts import Masks, crop_to_box, normalized_pixels

_SIDE = 1024  # [pixels] of the published weights
_CORNERS = np.array([[2, 3]], np.float32)  # SAM's labels of a box's two corners


class Network(Protocol):
    """Encoder and decoder. ``side``: size of the encoder's square input [pixels]."""

    side: int

    def encode(self, picture: NDArray[np.float32]) -> NDArray[np.float32]:
        """The embedding of a picture (1, 3, side, side)."""
        ...

    def decode(self, inputs: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
        """Mask logits (1, 1 or 4, height, width) in the size of the original picture."""
        ...


class OnnxNetwork:
    """A ``Network`` in two files under ONNX Runtime."""

    def __init__(self, path: Path, runtime: Runtime) -> None:
        self._encoder, self._decoder = (
            open_session(path / "encoder.onnx", runtime),
            open_session(path / "decoder.onnx", runtime),
        )
        shape = self._encoder.get_inputs()[0].shape
        wanted = {"image_embeddings", "point_coords", "point_labels", "mask_input", "has_mask_input", "orig_im_size"}
        if len(shape) != 4 or {i.name for i in self._decoder.get_inputs()} != wanted:
            raise PerceptionError(
                f"expected in {path} an encoder of (1, 3, side, side) and a decoder of {', '.join(sorted(wanted))}; got "
                f"an encoder of {shape}. Export them anew: docs/use/models.md has the lines"
            )
        self.side = shape[3] if isinstance(shape[3], int) else _SIDE  # if it is a name, the file accepts any size

    def encode(self, picture: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(self._encoder.run(None, {self._encoder.get_inputs()[0].name: picture})[0], np.float32)

    def decode(self, inputs: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
        return np.asarray(self._decoder.run(["masks"], inputs)[0], np.float32)


def load_network(path: Path, runtime: Runtime) -> Network:
    """Loads MobileSAM from a folder of ONNX files, or from a checkpoint.

    Raises:
        PerceptionError: it can't be loaded.
    """
    if path.suffix == ".pt":
        try:
            from surveilnav.perception.segmenters.mobile_sam_torch import TorchNetwork
        except ImportError as error:
            raise PerceptionError(MISSING_PACKAGES.format(path.name, error)) from error
        return TorchNetwork(path, runtime)
    missing = [name for name in ("encoder.onnx", "decoder.onnx") if not (path / name).is_file()]
    if missing:
        raise PerceptionError(
            f"{path} has no {' and no '.join(missing)}: expected both files of MobileSAM's ONNX export "
            "(docs/use/models.md), or mobile_sam.pt"
        )
    return OnnxNetwork(path, runtime)


class MobileSam:
    """A ``Segmenter``. ``path``: a folder or a checkpoint; ``model``: the model's id."""

    def __init__(self, path: Path, model: str, runtime: Runtime | None = None) -> None:
        self.model, self._network = model, load_network(path, runtime or Runtime())

    def segment(self, views: Sequence[RgbdView], boxes: Sequence[NDArray[np.float32]]) -> list[Masks]:
        """See ``Segmenter.segment``. A picture is encoded once, then each of its boxes is decoded."""
        return [
            self._segment_view(view.rgb, xyxy) if len(xyxy) else [] for view, xyxy in zip(views, boxes, strict=True)
        ]

    def _segment_view(self, rgb: NDArray[np.uint8], xyxy: NDArray[np.float32]) -> Masks:
        height, width = rgb.shape[:2]
        picture, scale = pad_to_square(rgb, self._network.side)
        quarter = self._network.side // 4  # size of the optional mask prompt, which isn't used
        given: dict[str, NDArray[np.float32]] = {
            "image_embeddings": self._network.encode(picture),
            "point_labels": _CORNERS,
            "mask_input": np.zeros((1, 1, quarter, quarter), np.float32),
            "has_mask_input": np.zeros(1, np.float32),
            "orig_im_size": np.array([height, width], np.float32),
        }
        masks: Masks = []
        for box in xyxy:
            corners = (box.reshape(1, 2, 2) * scale).astype(np.float32)
            # The first of four masks is the one for unambiguous prompts, such as boxes.
            masks.append(crop_to_box(self._network.decode({**given, "point_coords": corners})[0, 0] > 0, box))
        return masks


def pad_to_square(rgb: NDArray[np.uint8], side: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """A normalised picture (1, 3, side, side), scaled and padded with zeros on the right and below; and its scale (x, y)."""
    height, width = rgb.shape[:2]
    longest = max(height, width)
    new_height, new_width = (int(size * side / longest + 0.5) for size in (height, width))
    picture = np.zeros((1, 3, side, side), np.float32)
    picture[0, :, :new_height, :new_width] = normalized_pixels(rgb, new_width, new_height)
    return picture, np.array([new_width / width, new_height / height], np.float32)
