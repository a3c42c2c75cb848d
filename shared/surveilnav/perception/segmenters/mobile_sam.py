"""MobileSAM (Zhang et al. 2023, arXiv 2306.14289): SAM's prompts and masks behind a small encoder.

It runs from its checkpoint ``mobile_sam.pt``, which needs the extra ``mobile-sam``, or from a folder with two ONNX files:
``encoder.onnx`` (pictures to embeddings) and ``decoder.onnx`` (embeddings and points to masks). MobileSAM's package has
an export of the decoder; docs/use/models.md has ten lines that write both. Both ways have the same inputs and outputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import PerceptionError
from surveilnav.perception.detectors.onnx_file import session
from surveilnav.perception.protocols import RgbdView
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.segmenters.box_prompts import Masks, in_box, pixels

_SIDE = 1024  # [pixels] of the published weights
_CORNERS = np.array([[2, 3]], np.float32)  # SAM's labels of a box's two corners

#: What to do about a checkpoint whose packages aren't here; of its name and the error.
LACKING = (
    "{} needs the packages mobile_sam, timm, torch and torchvision ({}): pip install "
    "'surveilnav[perception-torch,mobile-sam]', or take another segmenter: SURVEILNAV_PERCEPTION__SEGMENTER=sam2.1-tiny"
)


class Network(Protocol):
    """Encoder and decoder. ``side``: of the square pictures that the encoder takes [pixels]."""

    side: int

    def encode(self, picture: NDArray[np.float32]) -> NDArray[np.float32]:
        """The embedding of (1, 3, side, side)."""
        ...

    def decode(self, inputs: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
        """Mask logits (1, 1 or 4, height, width) of the original picture."""
        ...


class OnnxNetwork:
    """See ``Network``: two files under ONNX Runtime."""

    def __init__(self, path: Path, runtime: Runtime) -> None:
        self._encoder, self._decoder = session(path / "encoder.onnx", runtime), session(path / "decoder.onnx", runtime)
        shape = self._encoder.get_inputs()[0].shape
        wanted = {"image_embeddings", "point_coords", "point_labels", "mask_input", "has_mask_input", "orig_im_size"}
        if len(shape) != 4 or {i.name for i in self._decoder.get_inputs()} != wanted:
            raise PerceptionError(
                f"expected in {path} an encoder of (1, 3, side, side) and a decoder of {', '.join(sorted(wanted))}; got "
                f"an encoder of {shape}. Export them anew: docs/use/models.md has the lines"
            )
        self.side = shape[3] if isinstance(shape[3], int) else _SIDE  # a name: the file takes any

    def encode(self, picture: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(self._encoder.run(None, {self._encoder.get_inputs()[0].name: picture})[0], np.float32)

    def decode(self, inputs: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
        return np.asarray(self._decoder.run(["masks"], inputs)[0], np.float32)


def network(path: Path, runtime: Runtime) -> Network:
    """MobileSAM in a folder of ONNX files, or in a checkpoint.

    Raises:
        PerceptionError: it can't be loaded.
    """
    if path.suffix == ".pt":
        try:
            from surveilnav.perception.segmenters.mobile_sam_torch import TorchNetwork
        except ImportError as error:
            raise PerceptionError(LACKING.format(path.name, error)) from error
        return TorchNetwork(path, runtime)
    missing = [name for name in ("encoder.onnx", "decoder.onnx") if not (path / name).is_file()]
    if missing:
        raise PerceptionError(
            f"{path} has no {' and no '.join(missing)}: expected both files of MobileSAM's ONNX export "
            "(docs/use/models.md), or mobile_sam.pt"
        )
    return OnnxNetwork(path, runtime)


class MobileSam:
    """The segmenter of this module. ``path``: a folder or a checkpoint; ``model``: its id."""

    def __init__(self, path: Path, model: str, runtime: Runtime | None = None) -> None:
        self.model, self._network = model, network(path, runtime or Runtime())

    def segment(self, views: Sequence[RgbdView], boxes: Sequence[NDArray[np.float32]]) -> list[Masks]:
        """See ``Segmenter.segment``: a picture is encoded once, then each of its boxes decoded."""
        return [self._one(view.rgb, xyxy) if len(xyxy) else [] for view, xyxy in zip(views, boxes, strict=True)]

    def _one(self, rgb: NDArray[np.uint8], xyxy: NDArray[np.float32]) -> Masks:
        height, width = rgb.shape[:2]
        picture, scale = framed(rgb, self._network.side)
        quarter = self._network.side // 4  # the size of a mask that could be given, and isn't
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
            # The first mask is the one for prompts that aren't ambiguous, such as boxes.
            masks.append(in_box(self._network.decode({**given, "point_coords": corners})[0, 0] > 0, box))
        return masks


def framed(rgb: NDArray[np.uint8], side: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(1, 3, side, side) of a picture: its longer side made ``side`` pixels, normalised, then zeros on the right and
    below; and the factors of x and y."""
    height, width = rgb.shape[:2]
    longest = max(height, width)
    new_height, new_width = (int(size * side / longest + 0.5) for size in (height, width))
    picture = np.zeros((1, 3, side, side), np.float32)
    picture[0, :, :new_height, :new_width] = pixels(rgb, new_width, new_height)
    return picture, np.array([new_width / width, new_height / height], np.float32)
