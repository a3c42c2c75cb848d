"""Which backend runs, and why: in words for the console and the report."""

from __future__ import annotations

from collections.abc import Sequence

from surveilnav.errors import PerceptionError
from surveilnav.perception import Backend, detectors, weights
from surveilnav.perception.onnx_coco import OnnxCoco, Thresholds
from surveilnav.perception.truth import Oracle, Simulated

BACKENDS: tuple[str, ...] = ("auto", "onnx-coco", "oracle", "simulated")
#: The pairs that did best for their time on rendered homes: for robots' views, and for cameras' (the first in tiles).
DEFAULT_DETECTORS: tuple[str, ...] = ("yolox-nano", "picodet-s")
DEFAULT_LARGE_DETECTORS: tuple[str, ...] = ("yolox-nano", "deimv2-femto")


def choose_backend(
    name: str = "auto",
    *,
    detector_names: Sequence[str] = DEFAULT_DETECTORS,
    large_detector_names: Sequence[str] = DEFAULT_LARGE_DETECTORS,
    thresholds: Thresholds | None = None,
    threads: int = 1,
    seed: int = 0,
    harder: float = 0.0,
    download: bool = True,
) -> Backend:
    """The backend of that name; "auto" takes the best that can run.

    Args:
        detector_names: the weights of ``onnx-coco`` (``weights.WEIGHTS``) for views of up to 900 pixels.
        large_detector_names: the same for larger ones.
        thresholds: of ``onnx-coco``.
        threads: of each network.
        seed, harder: of ``simulated``.
        download: whether weights may be fetched.

    Raises:
        PerceptionError: it can't run; the message says what is missing.
    """
    if name == "oracle":
        return Oracle()
    if name == "simulated":
        return Simulated(
            "asked for by name: the simulator's own instance ids through an error model", seed, harder=harder
        )
    names = (tuple(detector_names), tuple(large_detector_names))
    if name == "onnx-coco":
        return _onnx_coco(*names, thresholds, threads, download, "asked for by name")
    if name != "auto":
        raise PerceptionError(f"expected a perception backend out of {', '.join(BACKENDS)}, got {name!r}")
    try:
        return _onnx_coco(*names, thresholds, threads, download, "the best that runs here")
    except PerceptionError as error:
        return Simulated(
            "no real detector: the simulator's own instance ids through an error model stand in, "
            f"so these figures aren't a detector's. onnx-coco can't run: {error}",
            seed,
        )


def _onnx_coco(
    small: tuple[str, ...],
    large: tuple[str, ...],
    thresholds: Thresholds | None,
    threads: int,
    download: bool,
    reason: str,
) -> OnnxCoco:
    if not small or not large:
        raise PerceptionError(f"onnx-coco needs at least one detector out of {sorted(weights.WEIGHTS)}")
    loaded = {
        n: detectors.load(weights.find(n, download=download), weights.WEIGHTS[n].family, threads)
        for n in dict.fromkeys((*small, *large))
    }
    said = " + ".join(small) if small == large else f"{' + '.join(small)}; for cameras {' + '.join(large)}"
    kind = "a real detector" if len(loaded) == 1 else "real detectors that have to agree"
    return OnnxCoco(
        [loaded[n] for n in small],
        f"{kind} ({said}), {reason}",
        large=[loaded[n] for n in large],
        thresholds=thresholds,
    )
