"""Fits how likely a detection is what it is called, and says how well that holds in buildings that were left out.

    python -m benchmark.studies.calibration.chances [--backend compact] [--views 100]

The views are those of ``benchmark.studies.calibration``: what a backend finds in rendered views of train buildings, and what
they truly show. A detection is right if the thing whose box it fits, or which most of its mask shows, is of its class. The
table goes to the library's data/chances/<backend>.json, the page to docs/results/calibration.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmark.dataset.splits import SPLITS
from benchmark.studies.calibration.run import OUT, measured
from benchmark.studies.calibration.views import MIN_SIZE_RAD, Look, Looks, owners_of
from simulator.furniture.labels import TARGETS
from simulator.truth.choose import choose_backend
from simulator.truth.visible import VisibleThing, candidates
from surveilnav.errors import PerceptionError, SurveilNavError
from surveilnav.perception import Backend
from surveilnav.perception.chances import ChanceTable, ClassTerms, Floats, features, size_rad
from surveilnav.perception.vocabulary import DATA

DEFAULT = "onnx-coco"
#: A class with fewer detections has no terms of its own.
_FEWEST = 25
#: Standard deviations of a class's own terms: few data stay near all others.
_EVEN_SD, _SLOPE_SD, _POOLED_SD = 1.0, 0.4, 3.0
_FOLDS = 5
_BINS = np.array([0.0, 0.1, 0.25, 0.4, 0.6, 0.8, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """N detections whose truth is known: ``building`` (N,) number, ``label`` (N,), ``x`` (N, 5) as of ``features``, ``score``
    (N,), ``right`` (N,)."""

    building: NDArray[np.int64]
    label: NDArray[np.str_]
    x: Floats
    score: Floats
    right: NDArray[np.bool_]

    def where(self, keep: NDArray) -> Judged:
        return Judged(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))


def judged(buildings: Sequence[Looks]) -> Judged:
    """All detections in the views of buildings."""
    rows = [
        (number, d.label, d.score, size_rad(d.box_px, look.camera.fx_px), d.depth_m, look.is_camera, right)
        for number, building in enumerate(buildings)
        for look in building.looks
        for d, right in zip(look.found, _rightness(building, look), strict=True)
    ]
    building, label, score, size, range_m, camera, right = (np.array(column) for column in zip(*rows, strict=True))
    return Judged(building, label, features(score, size, range_m, camera), score, right)


def _rightness(building: Looks, look: Look) -> list[bool]:
    """Of every detection of a view, whether it is what it is called."""
    truth, depth_m = look.truth(building.labels)
    shown = candidates(truth, depth_m, look.camera, look.is_camera, MIN_SIZE_RAD)
    things = [t for c in shown for t in c.shown if isinstance(t, VisibleThing)]
    owners = owners_of(things, look.found)
    return [owner is not None and owner.label == d.label for d, owner in zip(look.found, owners, strict=True)]


def fit(rows: Judged, source: str = "") -> ChanceTable:
    """The maximum a posteriori: terms of all, and each class's own part of the constant and of the score's slope."""
    classes = [c for c in sorted(set(rows.label.tolist())) if (rows.label == c).sum() >= _FEWEST]
    owner = np.array([classes.index(label) if label in classes else len(classes) for label in rows.label.tolist()])
    n = 1 + rows.x.shape[1]
    columns = np.column_stack([np.ones(len(rows.x)), rows.x])
    sd = np.concatenate([np.full(n, _POOLED_SD), np.tile([_EVEN_SD, _SLOPE_SD], len(classes))])
    sign = np.where(rows.right, 1.0, -1.0)

    def loss(w: Floats) -> tuple[float, Floats]:
        own = np.vstack([w[n:].reshape(len(classes), 2), np.zeros(2)])
        eta = columns @ w[:n] + (columns[:, :2] * own[owner]).sum(axis=1)
        log_p = -np.logaddexp(0.0, -sign * eta)
        slope = -sign * np.exp(-np.logaddexp(0.0, sign * eta))
        grad = np.zeros((len(classes) + 1, 2))
        np.add.at(grad, owner, slope[:, None] * columns[:, :2])
        gradient = np.concatenate([slope @ columns, grad[: len(classes)].ravel()])
        return float(-log_p.sum() + 0.5 * ((w / sd) ** 2).sum()), gradient + w / sd**2

    w = minimize(loss, np.zeros(len(sd)), jac=True, method="L-BFGS-B", options={"maxiter": 1000}).x.round(3).tolist()
    even, slope, size, squared, far, camera = w[:n]
    by_class = {
        label: ClassTerms(w[n + 2 * i], w[n + 2 * i + 1], _share(rows.right[rows.label == label]),
                          int((rows.label == label).sum()))
        for i, label in enumerate(classes)
    }  # fmt: skip
    return ChanceTable(source, even, slope, size, squared, far, camera, _share(rows.right), by_class)


def _share(right: NDArray[np.bool_]) -> float:
    """Of what is right, with one of each added."""
    return round(float((right.sum() + 1) / (len(right) + 2)), 3)


def chances_of(table: ChanceTable, rows: Judged) -> Floats:
    """(N,) the table's chances."""
    return np.array([table.of_features(label, x) for label, x in zip(rows.label.tolist(), rows.x, strict=True)])


def left_out(rows: Judged) -> Floats:
    """(N,) chances by tables that never saw the building."""
    chance = np.zeros(len(rows.right))
    fold = rows.building % _FOLDS
    for k in range(min(_FOLDS, len(set(rows.building.tolist())))):
        chance[fold == k] = chances_of(fit(rows.where(fold != k)), rows.where(fold == k))
    return chance


def expected_error(chance: Floats, right: NDArray[np.bool_]) -> float:
    """Expected calibration error (Naeini et al. 2015) over ``_BINS``."""
    at = np.clip(np.digitize(chance, _BINS) - 1, 0, len(_BINS) - 2)
    parts = [(chance[at == b], right[at == b]) for b in range(len(_BINS) - 1) if (at == b).any()]
    return float(sum(len(c) * abs(c.mean() - r.mean()) for c, r in parts) / len(chance))


def page(rows: Judged, chance: Floats, table: ChanceTable, backend: str = DEFAULT) -> str:
    """What it says, in Markdown."""
    targets = np.isin(rows.label, TARGETS)
    n_buildings = len(set(rows.building.tolist()))
    raw, table_s = (expected_error(values, rows.right) for values in (rows.score, chance))
    lines = [
        "# How likely a detection is right", "",
        f"Of detections that the table calls likely by p, about p are right. Each of {n_buildings} buildings was "
        f"judged by a table of others. The expected calibration error is {table_s:.3f}; of raw scores it is {raw:.3f}.", "",
        f"Source: {table.source}. Fitted by `python -m benchmark.studies.calibration.chances"
        f"{'' if backend == DEFAULT else f' --backend {backend}'}`.", "",
        "| what | detections | mean score | mean chance | right | Brier score: of scores | of chances |",
        "|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    camera = rows.x[:, 4] > 0
    groups = {
        "all": np.ones(len(rows.right), bool), "the six targets": targets, "targets, robot views": targets & ~camera,
        "targets, camera views": targets & camera, **{label: rows.label == label for label in TARGETS},
    }  # fmt: skip
    for name, of in groups.items():
        if of.any():
            s, c, r = rows.score[of], chance[of], rows.right[of]
            lines.append(
                f"| {name} | {of.sum()} | {s.mean():.2f} | {c.mean():.2f} | {r.mean():.2f} | {((s - r) ** 2).mean():.3f} | "
                f"{((c - r) ** 2).mean():.3f} |"
            )
    lines += ["", "| chance | targets called so | mean chance | right |", "|---|---|---|---|"]
    for low, high in pairwise(_BINS.tolist()):
        of = targets & (chance >= low) & (chance < high)
        if of.any():
            lines.append(
                f"| {low:g} to {high:g} | {of.sum()} | {chance[of].mean():.2f} | {rows.right[of].mean():.2f} |"
            )
    return "\n".join([*lines, ""])


def main(argv: Sequence[str] | None = None) -> int:
    """Measures what isn't measured yet, fits, and writes table and page."""
    parser = argparse.ArgumentParser(
        prog="benchmark.studies.calibration.chances", description=__doc__.partition("\n")[0]
    )
    parser.add_argument("--backend", default=DEFAULT, help="what looks at the pictures; it has a vocabulary")
    parser.add_argument("--views", type=int, default=100, help="of the robot, about, in every building")
    parser.add_argument("--every", type=int, default=4, help="every so many scenes of train")
    parser.add_argument("--most", type=int, default=12, help="scenes at most")
    parser.add_argument("--out", type=Path, help=f"{OUT}/chances.md, of other backends chances_<backend>.md")
    args = parser.parse_args(argv)
    scenes = SPLITS["train"].scenes[:: args.every][: args.most]
    try:
        backend = None if args.backend == DEFAULT else _with_vocabulary(args.backend)
        buildings = [measured(scene, args.views, backend) for scene in scenes]
    except SurveilNavError as error:
        print(f"chances: {error}", file=sys.stderr)
        return 2
    if not any(look.found for building in buildings for look in building.looks):
        print(f"chances: {args.backend} found nothing in any view", file=sys.stderr)
        return 2
    rows = judged(buildings)
    names = ", ".join(scene.scene for scene in scenes)
    n_views = sum(len(b.looks) for b in buildings)
    model = args.backend if backend is None else backend.models.detector
    table = fit(rows, f"{len(rows.right)} detections of {model} in {n_views} views of {names}")
    path = DATA / "chances" / f"{args.backend}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(msgspec.json.format(msgspec.json.encode(table), indent=1) + b"\n")
    out = args.out or OUT / ("chances.md" if backend is None else f"chances_{args.backend}.md")
    out.write_text(page(rows, left_out(rows), table, args.backend), encoding="utf-8")
    return 0


def _with_vocabulary(name: str) -> Backend:
    """The backend of a name. PerceptionError: it can't run, or finds only what it is asked for."""
    backend = choose_backend(name)
    if backend.vocabulary is None or backend.needs_truth:
        raise PerceptionError(f"expected a detector that looks at pixels and has a vocabulary, and {name} is none")
    return backend


if __name__ == "__main__":
    sys.exit(main())
