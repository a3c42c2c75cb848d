"""Detector weights: where they come from, and that they are what they should be."""

from __future__ import annotations

import hashlib
import tempfile
from dataclasses import dataclass
from pathlib import Path

import httpx

from surveilnav.config import cache_dir, models_dir
from surveilnav.errors import PerceptionError

_GITHUB = "https://raw.githubusercontent.com"
_TIMEOUT = httpx.Timeout(60.0, connect=5.0)


@dataclass(frozen=True, slots=True)
class Weights:
    """One file of weights: family (``detectors.load``), size, hash, public address, licence."""

    name: str
    family: str
    file: str
    n_bytes: int
    sha256: str
    url: str
    license: str


WEIGHTS: dict[str, Weights] = {
    w.name: w
    for w in (
        Weights(
            "yolox-nano", "yolox", "yolox_nano.onnx", 3_660_092,
            "695e750a5d5754bb5a8d5325643b59282191a7e7a564e435a415fd3c578eab14",
            f"{_GITHUB}/Kazuhito00/YOLOX-ONNX-TFLite-Sample/ac07155e3ac8a531d89d24204e50f364d3444275/model/yolox_nano.onnx",
            "Apache-2.0 (Megvii YOLOX)",
        ),
        Weights(
            "deimv2-femto", "deimv2", "deimv2_hgnetv2_femto_coco.onnx", 4_116_144,
            "c6ad358f750132b891165e034c2ba507abefc5ebe1c1d2732a0acbcacc47e52c",
            f"{_GITHUB}/Kazuhito00/DEIMv2-ONNX-Sample/main/model/deimv2_hgnetv2_femto_coco.onnx",
            "Apache-2.0 (DEIMv2)",
        ),
        Weights(
            "deimv2-atto", "deimv2", "deimv2_hgnetv2_atto_coco.onnx", 2_248_408,
            "b114aa6610ac7c2bd9b3186ffb001afa872430db957407ef2473f7148d00646e",
            f"{_GITHUB}/Kazuhito00/DEIMv2-ONNX-Sample/main/model/deimv2_hgnetv2_atto_coco.onnx",
            "Apache-2.0 (DEIMv2)",
        ),
        Weights(
            "picodet-s", "picodet", "picodet_s_416_coco.onnx", 4_040_573,
            "cdab77bdde16e4f76bec734c4e5791801d1739e4c7ec1995e0e110e04300d0c2",
            f"{_GITHUB}/hpc203/picodet-onnxruntime/6bd166c3944bf8b3a0c41951344ecb5101af756a/coco/picodet_s_416_coco.onnx",
            "Apache-2.0 (PaddleDetection)",
        ),
    )
}  # fmt: skip


def find(name: str, *, download: bool = True) -> Path:
    """The file of weights called ``name``: from SURVEILNAV_MODELS_DIR, else the cache, else its public address.

    Raises:
        PerceptionError: it can't be had, or what is there isn't it.
    """
    if name not in WEIGHTS:
        raise PerceptionError(f"expected one of the weights {sorted(WEIGHTS)}, got {name!r}")
    weights = WEIGHTS[name]
    given = models_dir()
    if given is not None and (given / weights.file).is_file():
        return _checked(given / weights.file, weights)
    cached = cache_dir() / "models" / weights.file
    if cached.is_file():
        return _checked(cached, weights)
    if not download:
        raise PerceptionError(f"the weights {weights.file} aren't on this machine")
    _download(weights, cached)
    return cached


def _checked(path: Path, weights: Weights) -> Path:
    found = hashlib.sha256(path.read_bytes()).hexdigest()
    if found != weights.sha256:
        raise PerceptionError(
            f"{path} isn't what {weights.name} should be: its sha256 begins {found[:12]}, not {weights.sha256[:12]}. "
            "Remove it, and it will be downloaded again."
        )
    return path


def _download(weights: Weights, path: Path) -> None:
    """Streams the file beside its place, checks size and hash, and moves it there in one step."""
    path.parent.mkdir(parents=True, exist_ok=True)
    digest, n = hashlib.sha256(), 0
    handle, partial = tempfile.mkstemp(dir=path.parent, prefix=weights.file)
    try:
        with (
            open(handle, "wb") as out,
            httpx.stream("GET", weights.url, timeout=_TIMEOUT, follow_redirects=True) as answer,
        ):
            answer.raise_for_status()
            for chunk in answer.iter_bytes():
                n += len(chunk)
                if n > weights.n_bytes:
                    break
                digest.update(chunk)
                out.write(chunk)
        if n != weights.n_bytes or digest.hexdigest() != weights.sha256:
            raise PerceptionError(f"{weights.url} holds another file than expected ({weights.n_bytes} bytes): not used")
        Path(partial).replace(path)
    except (httpx.HTTPError, OSError) as error:
        raise PerceptionError(
            f"the weights {weights.file} aren't on this machine and can't be downloaded from {weights.url} "
            f"({type(error).__name__}: {error}). Put the file into a directory and point SURVEILNAV_MODELS_DIR at it."
        ) from error
    finally:
        Path(partial).unlink(missing_ok=True)
