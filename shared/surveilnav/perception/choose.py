"""Which backend runs, and why: in words for the console and the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

from surveilnav.errors import PerceptionError
from surveilnav.perception import Backend, detectors, models
from surveilnav.perception.onnx_coco import OnnxCoco, Thresholds

#: The pairs that did best for their time on rendered homes: for robots' views, and for cameras' (the first in tiles).
DEFAULT_DETECTORS: tuple[str, ...] = ("yolox-nano", "picodet-s")
DEFAULT_LARGE_DETECTORS: tuple[str, ...] = ("yolox-nano", "deimv2-femto")

#: Makes a backend that is told why it runs.
Maker = Callable[[str], Backend]
_NONE: Mapping[str, Maker] = MappingProxyType({})


def choose_backend(
    name: str = "auto",
    *,
    detector_names: Sequence[str] = DEFAULT_DETECTORS,
    large_detector_names: Sequence[str] = DEFAULT_LARGE_DETECTORS,
    thresholds: Thresholds | None = None,
    threads: int = 1,
    download: bool = True,
    others: Mapping[str, Maker] = _NONE,
    stand_in: str = "",
) -> Backend:
    """The backend of that name; "auto" takes the best that can run.

    Args:
        detector_names: the detectors of ``onnx-coco`` (``models.COCO_DETECTORS``) for views of up to 900 pixels.
        large_detector_names: the same for larger ones.
        thresholds: of ``onnx-coco``.
        threads: of each network.
        download: whether weights may be fetched.
        others: backends that this library doesn't have, by name: those of a simulator.
        stand_in: which of them "auto" takes where no real detector can run; empty: none.

    Raises:
        PerceptionError: it can't run; the message says what is missing.
    """
    if name in others:
        return others[name]("asked for by name")
    if name not in ("auto", "onnx-coco"):
        raise PerceptionError(
            f"expected a perception backend out of {', '.join(('auto', 'onnx-coco', *others))}, got {name!r}"
        )
    reason = "asked for by name" if name == "onnx-coco" else "the best that runs here"
    try:
        return _onnx_coco(tuple(detector_names), tuple(large_detector_names), thresholds, threads, download, reason)
    except PerceptionError as error:
        if name == "onnx-coco" or not stand_in:
            raise
        return others[stand_in](f"no real detector: onnx-coco can't run: {error}")


def _onnx_coco(
    small: tuple[str, ...],
    large: tuple[str, ...],
    thresholds: Thresholds | None,
    threads: int,
    download: bool,
    reason: str,
) -> OnnxCoco:
    if not small or not large:
        raise PerceptionError(f"onnx-coco needs at least one detector out of {sorted(models.COCO_DETECTORS)}")
    loaded = {
        n: detectors.load(models.find(n, download=download), models.family(n), threads)
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
