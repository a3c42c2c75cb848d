"""Detector, segmenter and embedder by their models' names. Each family has a file, which is loaded when it is asked for:
what needs PyTorch runs only where somebody wants it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from surveilnav.errors import PerceptionError
from surveilnav.perception import models
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


#: By family, what gives the class that reads it.
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

#: What a config.json says, where it isn't the family's name.
_FAMILY_OF_TYPE = MappingProxyType({"sam2_video": "sam2", "siglip2": "siglip"})


@dataclass(frozen=True, slots=True)
class _Model:
    """Where a model lies, who reads it, and its id."""

    path: Path
    family: str
    id: str


def load_detector(
    name: str, runtime: Runtime, *, words_per_pass: int = 0, threshold: float | None = None, download: bool = True
) -> Detector:
    """The detector with an open vocabulary that runs this model.

    Args:
        name: of a model, or a folder.
        runtime: where and how it runs.
        words_per_pass: of Grounding DINO's texts; 0: as many as fit.
        threshold: the score that a box needs; None: what its paper says.
        download: whether the model may be fetched.

    Raises:
        PerceptionError: it can't be had, isn't whole, or is no detector.
    """
    model = _found(name, download)
    more: dict[str, Any] = {} if threshold is None else {"threshold": threshold}
    if model.family.endswith("grounding-dino"):
        more["words_per_pass"] = words_per_pass
    made: Detector = _kind(model, name, _DETECTORS, "a detector")(model.path, model.id, runtime, **more)
    return made


def load_segmenter(name: str, runtime: Runtime, *, download: bool = True) -> Segmenter:
    """The segmenter that runs this model; "depth-in-box" needs none. PerceptionError: see ``load_detector``."""
    if name == DepthInBox.model:
        return DepthInBox()
    model = _found(name, download)
    made: Segmenter = _kind(model, name, _SEGMENTERS, "a segmenter")(model.path, model.id, runtime)
    return made


def load_embedder(name: str, runtime: Runtime, *, download: bool = True) -> Embedder:
    """The embedder that runs this model. PerceptionError: see ``load_detector``."""
    model = _found(name, download)
    made: Embedder = _kind(model, name, _EMBEDDERS, "an embedder")(model.path, model.id, runtime)
    return made


def runs_on_gpu(runtime: Runtime) -> bool:
    """Whether networks under PyTorch run on a GPU. PerceptionError: the device isn't there."""
    from surveilnav.perception.torch_model import device_named

    return bool(device_named(runtime.device).type == "cuda")


def _kind(model: _Model, name: str, table: _Table, what: str) -> Any:
    """The class that reads a model."""
    if model.family not in table:
        raise PerceptionError(f"expected {what} of {', '.join(table)}, and {name} is {model.family!r}")
    try:
        return table[model.family]()
    except ImportError as error:
        raise PerceptionError(
            f"{name} needs PyTorch and transformers, which can't be loaded here ({error}): "
            "pip install 'surveilnav[perception-torch]'"
        ) from error


def _found(name: str, download: bool) -> _Model:
    """The model of that name, checked."""
    path = models.find(name, download=download)
    said = models.family(name)
    return _Model(path, _FAMILY_OF_TYPE.get(said, said), models.model_id(name, path))
