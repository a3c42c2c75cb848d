"""What ``compact`` finds in views that training never saw, beside COCO detectors on the same views.

    python -m training.detector.evaluate --network runs/compact/compact.onnx --views data/views/val \\
        [--beside yolox-nano onnx-coco] [--threads 1] [--card]

AP50 by class, robot and camera views apart; an object counts if it shows at least ``--min-pixels`` pixels as sensed. Mask
IoU is with true boxes. Times are of whole calls at equal pixels (416 x 416), taken in turn in one run.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol

import cv2
import msgspec
import numpy as np

from surveilnav.geometry import Pinhole
from surveilnav.perception import models
from surveilnav.perception.boxes import Boxes, merge_overlapping, overlaps
from surveilnav.perception.detectors import coco
from surveilnav.perception.detectors.compact import CompactNetwork
from surveilnav.perception.detectors.onnx_file import open_session
from surveilnav.perception.models.card import Measured, card_of, save_card
from surveilnav.perception.pipeline import PipelineBackend
from surveilnav.perception.presets import NetworkSettings, onnx_coco
from surveilnav.perception.protocols import RgbdView
from surveilnav.perception.runtime import Runtime
from surveilnav.simulator.world.labels import TARGETS
from training.detector import classes
from training.detector.average_precision import ClassTally
from training.detector.pack import read_packs
from training.detector.views import TrainingView

_SAME_THING_IOU = 0.6
_SIDE = 416


def sensed(view: TrainingView) -> RgbdView:
    """A view as a backend gets it."""
    height, width = view.ids.shape
    return RgbdView(view.rgb, view.depth_m, Pinhole.from_hfov(width, height, view.hfov_rad))


class Finds(Protocol):
    """What finds boxes in a view."""

    name: str

    def detect(self, view: RgbdView) -> Boxes: ...


class Tally:
    """AP by class of one detector in one kind of views."""

    def __init__(self, names: Sequence[str], min_pixels: int) -> None:
        self.names, self.min_pixels = tuple(names), min_pixels
        self.by_class = {name: ClassTally() for name in names}

    def add(self, view: TrainingView, found: Boxes) -> None:
        """Judges what was found in a view."""
        known = classes.load().names
        words = list(found.words)
        for name in self.names:
            mine = view.labels == known.index(name)
            scores = found.scores[:, words.index(name)] if name in words else np.zeros(len(found), np.float32)
            reported = scores > 0
            self.by_class[name].add(
                found.xyxy[reported], scores[reported], view.boxes[mine], view.areas[mine] >= self.min_pixels
            )

    def mean(self, names: Sequence[str]) -> float:
        """Mean AP over those of the classes that have objects."""
        values = [self.by_class[name].ap for name in names if self.by_class[name].objects]
        return float(np.mean(values)) if values else float("nan")


def mask_ious(network: CompactNetwork, view: TrainingView, min_pixels: int) -> Iterator[float]:
    """IoU of each counted target's mask inside its true box, by the place whose box of its class fits best."""
    known, answer = classes.load().names, network.run(sensed(view))
    iou, _ = overlaps(view.boxes, answer.xyxy)
    for i, label in enumerate(view.labels.tolist()):
        if known[label] not in TARGETS or view.areas[i] < min_pixels:
            continue
        place = int(np.argmax(iou[i] * np.sqrt(answer.scores[:, label])))
        x0, y0, x1, y1 = (int(v) for v in view.boxes[i])
        mask, true = answer.mask(place, (x0, y0, x1, y1)), view.ids[y0:y1, x0:x1] == i + 1
        yield float((mask & true).sum() / max(1, (mask | true).sum()))


class _Merged:
    """A COCO network whose doubles are merged, as they are when it is used."""

    def __init__(self, network: coco.Network) -> None:
        self.name, self._network = network.name, network

    def detect(self, view: RgbdView) -> Boxes:
        return merge_overlapping(self._network.detect(view.rgb), _SAME_THING_IOU)


class _Pair:
    """The detectors of ``onnx-coco`` that have to agree, as they are used."""

    name = "onnx-coco"

    def __init__(self, threads: int) -> None:
        backend = onnx_coco(NetworkSettings(threads=threads, download=False), "to compare with")
        assert isinstance(backend, PipelineBackend), "made of three parts"
        self._detector = backend.detector

    def detect(self, view: RgbdView) -> Boxes:
        return self._detector.detect([view.rgb], [()])[0]


def beside(name: str, threads: int) -> Finds:
    """A COCO detector by name, or ``onnx-coco``, from ``SURVEILNAV_MODELS_DIR`` or the cache."""
    if name == _Pair.name:
        return _Pair(threads)
    return _Merged(coco.load(models.find(name, download=False), models.family(name), Runtime(threads=threads)))


def times_ms(detectors: Sequence[Finds], seen: TrainingView, n: int = 20) -> dict[str, float]:
    """Least processor milliseconds of a view made square, of 416 pixels, taken in turn: what else runs doesn't count."""
    size, hfov_rad = (_SIDE, _SIDE), seen.hfov_rad
    rgb = cv2.resize(seen.rgb, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    depth_m = cv2.resize(seen.depth_m, size, interpolation=cv2.INTER_NEAREST).astype(np.float32)
    view = RgbdView(rgb, depth_m, Pinhole.from_hfov(*size, hfov_rad))
    taken: defaultdict[str, list[float]] = defaultdict(list)
    for _ in range(n):
        for detector in detectors:
            start = time.process_time()
            detector.detect(view)
            taken[detector.name].append(1e3 * (time.process_time() - start))
    return {name: min(values) for name, values in taken.items()}


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="training.detector.evaluate", description=__doc__.partition("\n")[0])
    parser.add_argument("--network", type=Path, required=True, help="the ONNX file")
    parser.add_argument("--views", type=Path, required=True, help="packs made with --as-sensed")
    parser.add_argument("--beside", nargs="*", default=["yolox-nano", "onnx-coco"], help="COCO detectors")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--min-pixels", type=int, default=400)
    parser.add_argument("--card", action="store_true", help="write what is found into the card beside the network")
    args = parser.parse_args(argv)
    own = CompactNetwork(open_session(args.network, Runtime(threads=args.threads)))
    equal = CompactNetwork(open_session(args.network, Runtime(threads=args.threads)), side_px=_SIDE)
    detectors: list[Finds] = [own, *(beside(name, args.threads) for name in args.beside)]
    packs = read_packs(args.views, own.classes)
    tallies: dict[tuple[str, str], Tally] = {}
    masks: defaultdict[str, list[float]] = defaultdict(list)
    views: defaultdict[str, int] = defaultdict(int)
    for pack in packs:
        for i in range(len(pack.views)):
            view = pack.view(i)
            views[view.kind] += 1
            masks[view.kind] += mask_ious(own, view, args.min_pixels)
            for detector in detectors:
                tally = tallies.setdefault((view.kind, detector.name), Tally(own.classes, args.min_pixels))
                tally.add(view, detector.detect(sensed(view)))
    for line in lines(tallies, {kind: float(np.mean(values)) for kind, values in masks.items() if values}, dict(views)):
        print(line)
    ms = times_ms([equal, *detectors[1:]], packs[0].view(len(packs[0].views) - 1))
    print(f"processor ms at 416 x 416, {args.threads} threads:", ", ".join(f"{name} {t:.1f}" for name, t in ms.items()))
    if args.card:
        card = card_of(args.network)
        if card is None:
            parser.error(f"{args.network} has no card: `python -m training.detector.export` writes it")
        found = measured(
            own.name, tallies, {kind: float(np.mean(values)) for kind, values in masks.items() if values}, views
        )
        rounded = {name: round(t, 2) for name, t in ms.items()}
        save_card(args.network, msgspec.structs.replace(card, measured=found, ms=rounded))


def measured(
    own: str, tallies: Mapping[tuple[str, str], Tally], masks: Mapping[str, float], views: Mapping[str, int]
) -> dict[str, Measured]:
    """By kind of view, what the network called ``own`` found, and others beside it on the six goals. Of classes that have no
    objects nothing is reported."""
    found = {}
    for kind, n in sorted(views.items()):
        tally = tallies[kind, own]
        beside = {name: _rounded(t.mean(TARGETS)) for (of, name), t in tallies.items() if of == kind and name != own}
        by_class = {name: _rounded(tally.by_class[name].ap) for name in tally.names if tally.by_class[name].objects}
        ap50, ap50_all = _rounded(tally.mean(TARGETS)), _rounded(tally.mean(tally.names))
        found[kind] = Measured(n, ap50, ap50_all, _rounded(masks.get(kind, 0.0)), by_class, beside)
    return found


def _rounded(share: float) -> float:
    """To three digits; 0 where there is nothing to measure."""
    return 0.0 if math.isnan(share) else round(share, 3)


def lines(tallies: dict[tuple[str, str], Tally], masks: dict[str, float], views: dict[str, int]) -> Iterator[str]:
    """A table for people."""
    for kind in sorted(views, reverse=True):
        yield f"## {kind}: {views[kind]} views; mask IoU with true boxes {masks.get(kind, float('nan')):.2f}"
        shown = {name: tally for (of, name), tally in tallies.items() if of == kind}
        for name, tally in shown.items():
            goals = ", ".join(f"{c} {tally.by_class[c].ap:.2f} ({tally.by_class[c].objects})" for c in TARGETS)
            yield f"{name}: AP50 of the six {tally.mean(TARGETS):.3f}: {goals}"
        own = next(iter(shown.values()))
        others = [c for c in own.names if c not in TARGETS and own.by_class[c].objects]
        yield f"all {len(others) + len(TARGETS)} classes {own.mean(own.names):.3f}: " + ", ".join(
            f"{c} {own.by_class[c].ap:.2f} ({own.by_class[c].objects})" for c in others
        )


if __name__ == "__main__":
    main()
