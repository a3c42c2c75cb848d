"""Loads detectors, segmenters, embedders and networks for depth by the names of their models.

Each family of models has a module, which is imported only when one of its models is loaded: most need PyTorch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from surveilnav.errors import PerceptionError
from surveilnav.perception import models
from surveilnav.perception.depth.estimate import MetricDepthModel
from surveilnav.perception.protocols import Detector, Embedder, Segmenter
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.segmenters.depth_in_box import DepthInBox


def _grounding_dino() -> Any:
    from surveilnav.perception.detectors.grounding_dino import GroundingDino

    return GroundingDino


def _omdet_turbo() -> Any:
    from surveilnav.perception.detectors.omdet_turbo import OmDetTurbo

    return OmDetTurbo


def _owlv2() -> Any:
    from surveilnav.perception.detectors.owlv2 import Owlv2

    return Owlv2


def _yolo_world() -> Any:
    from surveilnav.perception.detectors.yolo_world import YoloWorld

    return YoloWorld


def _mobile_sam() -> Any:
    from surveilnav.perception.segmenters.mobile_sam import MobileSam

    return MobileSam


def _sam2() -> Any:
    from surveilnav.perception.segmenters.sam2 import Sam2

    return Sam2


def _clip() -> Any:
    from surveilnav.perception.embedders.clip import Clip

    return Clip


def _depth_anything() -> Any:
    from surveilnav.perception.depth.depth_anything import DepthAnything

    return DepthAnything


#: By family, the function that imports its class.
_Table = Mapping[str, Callable[[], Any]]
_DETECTORS: _Table = {
    "grounding-dino": _grounding_dino,
    "mm-grounding-dino": _grounding_dino,
    "omdet-turbo": _omdet_turbo,
    "owlv2": _owlv2,
    "yolo-world": _yolo_world,
}
_SEGMENTERS: _Table = {"mobile-sam": _mobile_sam, "sam2": _sam2}
_EMBEDDERS: _Table = {"clip": _clip, "siglip": _clip}
_DEPTH: _Table = {"depth_anything": _depth_anything}

#: Families whose model type in config.json is another word.
_FAMILY_OF_TYPE = MappingProxyType({"sam2_video": "sam2", "siglip2": "siglip"})


@dataclass(frozen=True, slots=True)
class _Model:
    """The path of a model's files, its family and its id."""

    path: Path
    family: str
    id: str


def load_detector(
    name: str, runtime: Runtime, *, words_per_pass: int = 0, threshold: float | None = None, download: bool = True
) -> Detector:
    """Loads an open-vocabulary detector.

    Args:
        name: name of a model, or a folder.
        words_per_pass: number of words in a text of Grounding DINO; 0: as many as fit.
        threshold: the score that a box needs; None: the one of its paper.

    Raises:
        PerceptionError: the model can't be found, is incomplete, or is no detector.
    """
    model = _find_model(name, download)
    options: dict[str, Any] = {} if threshold is None else {"threshold": threshold}
    if model.family.endswith("grounding-dino"):
        options["words_per_pass"] = words_per_pass
    loaded: Detector = _import_class(model, name, _DETECTORS, "a detector")(model.path, model.id, runtime, **options)
    return loaded


def load_segmenter(name: str, runtime: Runtime, *, download: bool = True) -> Segmenter:
    """Loads a segmenter; "depth-in-box" is one without a model. Raises PerceptionError like ``load_detector``."""
    if name == DepthInBox.model:
        return DepthInBox()
    model = _find_model(name, download)
    loaded: Segmenter = _import_class(model, name, _SEGMENTERS, "a segmenter")(model.path, model.id, runtime)
    return loaded


def load_embedder(name: str, runtime: Runtime, *, download: bool = True) -> Embedder:
    """Loads an embedder. Raises PerceptionError like ``load_detector``."""
    model = _find_model(name, download)
    loaded: Embedder = _import_class(model, name, _EMBEDDERS, "an embedder")(model.path, model.id, runtime)
    return loaded


def load_depth_model(name: str, runtime: Runtime, *, download: bool = True) -> MetricDepthModel:
    """Loads a network that estimates metric depth.

    Args:
        name: name of a model, a folder, or the path of a file ``.onnx``, which needs no PyTorch.

    Raises:
        PerceptionError: like ``load_detector``; the text also says where weights belong, and under which licence they are.
    """
    try:
        if name.endswith(".onnx"):
            from surveilnav.perception.depth.onnx_model import OnnxDepth

            path = models.find(name if "/" in name else f"./{name}")
            return OnnxDepth(path, models.model_id(name, path), runtime)
        model = _find_model(name, download)
        loaded: MetricDepthModel = _import_class(model, name, _DEPTH, "a depth network")(model.path, model.id, runtime)
    except PerceptionError as error:
        raise PerceptionError(f"{error}. {_DEPTH_WEIGHTS}") from error
    return loaded


_DEPTH_WEIGHTS = (
    "Weights for depth: `surveilnav models pull depth-anything-v2-metric-indoor-small` (Apache-2.0), or a folder in "
    "SURVEILNAV_MODELS_DIR. Depth Anything's base and large weights are CC-BY-NC-4.0: not for commercial use. "
    "SURVEILNAV_CAMERA__DEPTH=network needs neither weights nor PyTorch"
)


def runs_on_gpu(runtime: Runtime) -> bool:
    """Whether PyTorch's networks run on a GPU. Raises PerceptionError if the device doesn't exist."""
    from surveilnav.perception.torch_model import find_device

    return bool(find_device(runtime.device).type == "cuda")


def _import_class(model: _Model, name: str, table: _Table, what: str) -> Any:
    """The class that runs a model. ``what``: the kind of model that was expected, for the error message."""
    if model.family not in table:
        raise PerceptionError(f"expected {what} of {', '.join(table)}, and {name} is {model.family!r}")
    try:
        return table[model.family]()
    except ImportError as error:
        raise PerceptionError(
            f"{name} needs PyTorch and transformers, which can't be loaded here ({error}): "
            "pip install 'surveilnav[perception-torch]'"
        ) from error


def _find_model(name: str, download: bool) -> _Model:
    """Finds a model's files, and checks them."""
    path = models.find(name, download=download)
    family = models.family(name)
    return _Model(path, _FAMILY_OF_TYPE.get(family, family), models.model_id(name, path))
