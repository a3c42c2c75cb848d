"""Depth Anything V2 (Yang et al. 2024, arXiv 2406.09414), metric models, from a folder in the format of transformers.

Its metric heads are trained on Hypersim (indoor, up to 20 m) with depth along the optical axis. The picture is scaled so that its
shorter side has 518 pixels.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import transformers
from numpy.typing import NDArray

from surveilnav.errors import PerceptionError
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.torch_model import load_image_processor, load_model, to_numpy

MODEL_TYPES = ("depth_anything",)


class DepthAnything:
    """A ``MetricDepthModel``.

    Args:
        path: the folder, with config.json, preprocessor_config.json and weights.
        model: its id.
        runtime: device and number of threads.

    Raises:
        PerceptionError: it can't be loaded, or isn't a metric model.
    """

    def __init__(self, path: Path, model: str, runtime: Runtime | None = None) -> None:
        self.model = model
        self._model = load_model(transformers.AutoModelForDepthEstimation, path, MODEL_TYPES, runtime or Runtime())
        found = self._model.net.config.depth_estimation_type
        if found != "metric":
            raise PerceptionError(
                f"expected a metric model of Depth Anything V2, and {path} holds a {found} one, whose depth has no metres: "
                "take depth-anything-v2-metric-indoor-small or another whose name has Metric in it"
            )
        self._images = load_image_processor(path)

    def depth_m(self, rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
        """See ``MetricDepthModel.depth_m``."""
        pixels = self._images([rgb], return_tensors="np")["pixel_values"]
        with self._model.running():
            depth_m = to_numpy(self._model.net(pixel_values=self._model.tensor(pixels)).predicted_depth)[0]
        return np.asarray(cv2.resize(depth_m, rgb.shape[1::-1], interpolation=cv2.INTER_LINEAR))
