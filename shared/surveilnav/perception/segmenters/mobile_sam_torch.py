"""Runs MobileSAM's checkpoint with the package ``mobile_sam``, of the extra ``mobile-sam``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from surveilnav.errors import PerceptionError
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.segmenters import MISSING_PACKAGES
from surveilnav.perception.torch_model import TorchModel, find_device, to_numpy


class TorchNetwork:
    """A ``mobile_sam.Network``. Raises PerceptionError if the package or the file can't be loaded."""

    def __init__(self, path: Path, runtime: Runtime) -> None:
        try:
            from mobile_sam import sam_model_registry
            from mobile_sam.utils.onnx import SamOnnxModel
        except (ImportError, RuntimeError) as error:  # RuntimeError: torchvision was built for another torch
            raise PerceptionError(MISSING_PACKAGES.format(path.name, error)) from error
        torch.set_num_threads(runtime.threads)
        device = find_device(runtime.device)
        sam = sam_model_registry["vit_t"]()
        try:
            sam.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
        except Exception as error:  # unpickling may raise anything
            raise PerceptionError(f"{path} isn't MobileSAM's checkpoint: {str(error)[:200]}") from error
        sam = sam.to(device).eval()
        self._encoder = TorchModel(sam.image_encoder, device)
        self._decoder = TorchModel(SamOnnxModel(sam, return_single_mask=False), device)
        self.side = int(sam.image_encoder.img_size)

    def encode(self, picture: NDArray[np.float32]) -> NDArray[np.float32]:
        with self._encoder.running():
            return to_numpy(self._encoder.net(self._encoder.tensor(picture)))

    def decode(self, inputs: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
        with self._decoder.running():
            return to_numpy(self._decoder.net(**{k: self._decoder.tensor(v) for k, v in inputs.items()})[0])
