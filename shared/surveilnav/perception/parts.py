"""Detector, segmenter and embedder by their models' names. Each family has a file, which is loaded when it is asked for:
what needs PyTorch runs only where somebody wants it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from surveilnav.config import models_dir
from surveilnav.errors import PerceptionError
from surveilnav.perception.protocols import Detector, Embedder, Segmenter
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.segmenters.depth_in_box import DepthInBox

#: What a config.json says, where it isn't the family's name.
_FAMILY_OF_TYPE = MappingProxyType({"sam2_video": "sam2", "siglip2": "siglip"})


@dataclass(frozen=True, slots=True)
class _Model:
    """Where a model lies, who reads it, and its id."""

    path: Path
    family: str
    id: str


def detector(
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
    made: Detector = _class(model, name, _detector, "a detector of any word")(model.path, model.id, runtime, **more)
    return made


def segmenter(name: str, runtime: Runtime, *, download: bool = True) -> Segmenter:
    """The segmenter that runs this model; "depth-in-box" needs none. PerceptionError: see ``detector``."""
    if name == DepthInBox.model:
        return DepthInBox()
    model = _found(name, download)
    made: Segmenter = _class(model, name, _segmenter, "a segmenter")(model.path, model.id, runtime)
    return made


def embedder(name: str, runtime: Runtime, *, download: bool = True) -> Embedder:
    """The embedder that runs this model. PerceptionError: see ``detector``."""
    model = _found(name, download)
    made: Embedder = _class(model, name, _embedder, "an embedder")(model.path, model.id, runtime)
    return made


def _class(model: _Model, name: str, of_family: Callable[[str], Any], what: str) -> Any:
    """The class that reads a model, by a function that imports it."""
    try:
        kind = of_family(model.family)
    except ImportError as error:
        raise PerceptionError(
            f"{name} needs PyTorch and transformers, which can't be loaded here ({error}): "
            "pip install 'surveilnav[perception-torch]'"
        ) from error
    if kind is None:
        raise PerceptionError(f"expected a model that is {what}, and {name} is {model.family!r}")
    return kind


def _detector(family: str) -> Any:
    if family in ("grounding-dino", "mm-grounding-dino"):
        from surveilnav.perception.detectors.grounding_dino import GroundingDino

        return GroundingDino
    if family == "omdet-turbo":
        from surveilnav.perception.detectors.omdet_turbo import OmDetTurbo

        return OmDetTurbo
    if family == "owlv2":
        from surveilnav.perception.detectors.owlv2 import Owlv2

        return Owlv2
    return None


def _segmenter(family: str) -> Any:
    if family == "mobile-sam":
        from surveilnav.perception.segmenters.mobile_sam import MobileSam

        return MobileSam
    if family == "sam2":
        from surveilnav.perception.segmenters.sam2 import Sam2

        return Sam2
    return None


def _embedder(family: str) -> Any:
    if family in ("clip", "siglip"):
        from surveilnav.perception.embedders.clip import Clip

        return Clip
    return None


def _found(name: str, download: bool) -> _Model:
    """The model of that name: a path, or a folder or file in SURVEILNAV_MODELS_DIR."""
    given = models_dir()
    places = [Path(name).expanduser(), *([given / name, given / f"{name.replace('-', '_')}.pt"] if given else [])]
    path = next((place for place in places if name and place.exists()), None)
    if path is None:
        raise PerceptionError(
            f"expected the path of a model, or its name in SURVEILNAV_MODELS_DIR, got {name!r}, and nothing lies at "
            f"{' or '.join(map(str, places))}"
        )
    return _Model(path, _family(path), f"{path.stem if path.is_file() else path.name}@{_digest(path)}")


def _family(path: Path) -> str:
    if path.suffix == ".pt" or (path / "decoder.onnx").is_file():
        return "mobile-sam"
    try:
        said = str(json.loads((path / "config.json").read_bytes())["model_type"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise PerceptionError(f"{path} has no config.json that says what model it holds ({error})") from error
    return _FAMILY_OF_TYPE.get(said, said)


def _digest(path: Path) -> str:
    """Eight digits of the hash of what a model has learnt."""
    whole = hashlib.sha256()
    files = [path] if path.is_file() else [f for f in sorted(path.iterdir()) if f.suffix in _WEIGHTS]
    for file in files:
        with file.open("rb") as opened:
            whole.update(hashlib.file_digest(opened, "sha256").digest())
    return whole.hexdigest()[:8]


_WEIGHTS = (".safetensors", ".bin", ".onnx")
