"""Metric depth networks as ONNX files: Depth Anything V2 and its like, without PyTorch."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import PerceptionError
from surveilnav.perception.detectors.onnx_file import open_session
from surveilnav.perception.runtime import Runtime

#: Where the file leaves the input's size open: length of the shorter side, and what both sides are multiples of.
_SHORTER_PX, _MULTIPLE_PX = 518, 14
_MEAN, _STD = np.array([0.485, 0.456, 0.406], np.float32), np.array([0.229, 0.224, 0.225], np.float32)  # ImageNet's


class OnnxDepth:
    """A ``MetricDepthModel``: one input (1, 3, H, W), the picture normalised as for ImageNet; the first output is depth [m].

    Args:
        path: the file.
        model: its id.
        runtime: device and number of threads.

    Raises:
        PerceptionError: it can't be loaded, or has other inputs or outputs.
    """

    def __init__(self, path: Path, model: str, runtime: Runtime | None = None) -> None:
        self.model = model
        self._session = open_session(path, runtime or Runtime())
        inputs, output = self._session.get_inputs(), self._session.get_outputs()[0]
        first = inputs[0]
        if (
            len(inputs) != 1
            or len(first.shape) != 4
            or first.shape[1] not in (3, None)
            or first.type != "tensor(float)"
            or len(output.shape) not in (3, 4)
        ):
            raise PerceptionError(
                f"expected a depth network with one input (1, 3, H, W) of float32 whose first output is the depth (1, H, W); "
                f"{path.name} has inputs {', '.join(f'{one.name} {one.shape}' for one in inputs)} and the output {output.name} "
                f"{output.shape}"
            )
        self._input, self._output = first.name, output.name
        self._fixed = [side if isinstance(side, int) else None for side in first.shape[2:]]

    def depth_m(self, rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
        """See ``MetricDepthModel.depth_m``."""
        height, width = rgb.shape[:2]
        small = cv2.resize(rgb, self._input_size(width, height), interpolation=cv2.INTER_CUBIC)
        pixels = (small.astype(np.float32) / 255.0 - _MEAN) / _STD
        (depth_m,) = self._session.run([self._output], {self._input: pixels.transpose(2, 0, 1)[None]})
        depth_m = depth_m.reshape(depth_m.shape[-2:]).astype(np.float32)
        return np.asarray(cv2.resize(depth_m, (width, height), interpolation=cv2.INTER_LINEAR))

    def _input_size(self, width: int, height: int) -> tuple[int, int]:
        """(width, height) of the input: the file's, or the picture's shape with a shorter side of 518 pixels."""
        ratio = _SHORTER_PX / min(width, height)
        open_size = (math.ceil(round(side * ratio) / _MULTIPLE_PX) * _MULTIPLE_PX for side in (height, width))
        rows, columns = (fixed or free for fixed, free in zip(self._fixed, open_size, strict=True))
        return columns, rows
