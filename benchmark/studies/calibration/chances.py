"""Fits how likely a detection is what it is called, and says how well that holds in buildings that were left out.

    python -m surveilnav.benchmark.studies.calibration.chances [--backend compact] [--views 100]

The views are those of ``surveilnav.benchmark.studies.calibration``: what a backend finds in rendered views of train buildings,
and what
they truly show. ``compact`` learnt from those: for it they are of buildings that it never saw. A detection is right if the thing
whose box it fits, or which most of its mask shows, is of its class. A thing counts once for every name that it is given,
however many views show it: the next detection may be of any thing. The table goes to the library's
data/chances/<backend>.json, the page to docs/results/calibration.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from surveilnav.benchmark.dataset.splits import SceneSpec
from surveilnav.benchmark.studies.calibration.run import OUT, UNSEEN, measured
from surveilnav.benchmark.studies.calibration.views import (
    MIN_SIZE_RAD,
    MeasuredDetection,
    MeasuredView,
    MeasuredViews,
    owners_of,
)
from surveilnav.errors import PerceptionError, SurveilNavError
from surveilnav.perception.backend import Backend
from surveilnav.perception.chances import ChanceTable, ClassTerms, Floats, features, size_rad
from surveilnav.perception.vocabulary import DATA
from surveilnav.simulator.truth.choose import choose_backend
from surveilnav.simulator.truth.visible import VisibleThing, candidates, world_points
from surveilnav.simulator.world.labels import TARGETS

DEFAULT = "onnx-coco"
#: Train buildings: homes with ``train`` furniture, flats and offices.
BUILDINGS = (
    "2_bedroom",
    "2_bedroom_basement",
    "3_bedroom",
    "3_bedroom_mezzanine",
    "flats_1000",
    "office_1000",
    "office_1002",
    "office_1004",
    "office_1006",
    "office_1008",
    "office_1010",
)
#: Of a backend that learnt from views of those: others, which it never saw. Among what it knows it would be too sure.
BUILDINGS_OF = {"compact": UNSEEN}
#: A class with fewer detections has no terms of its own.
_FEWEST = 25
#: Standard deviations of a class's own terms: few data stay near all others.
_EVEN_SD, _SLOPE_SD, _POOLED_SD = 1.0, 0.4, 3.0
_FOLDS = 5
_BINS = np.array([0.0, 0.1, 0.25, 0.4, 0.6, 0.8, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """N detections whose truth is known: ``building`` (N,) number, ``label`` (N,), ``x`` (N, 5) as of ``features``, ``score``
    (N,), ``right`` (N,), ``weight`` (N,): one over how many detections call the same thing the same."""

    building: NDArray[np.int64]
    label: NDArray[np.str_]
    x: Floats
    score: Floats
    right: NDArray[np.bool_]
    weight: Floats

    def where(self, keep: NDArray) -> Judged:
        return Judged(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))


def judged(buildings: Sequence[MeasuredViews]) -> Judged:
    """All detections in the views of buildings."""
    rows = [
        (number, d.label, d.score, size_rad(d.box_px, look.camera.fx_px), d.depth_m, look.is_camera, owner)
        for number, building in enumerate(buildings)
        for look in building.views
        for d, owner in zip(look.found, true_owners(building, look), strict=True)
    ]
    things = [(number, label, owner[:-1]) for number, label, *_, owner in rows]
    often = Counter(things)
    right = np.array([owner[-1] == label for _, label, *_, owner in rows])
    building, label, score, size, range_m, camera = (np.array(column) for column in [*zip(*rows, strict=True)][:-1])
    weight = np.array([1.0 / often[thing] for thing in things])
    return Judged(building, label, features(score, size, range_m, camera), score, right, weight)


def true_owners(building: MeasuredViews, look: MeasuredView) -> list[tuple[Any, ...]]:
    """Of every detection of a view, which thing it shows, and last what that truly is; of one that shows none, the metre of the
    world that it lies in, and ""."""
    truth, depth_m = look.truth(building.labels)
    shown = candidates(truth, depth_m, look.camera, look.is_camera, MIN_SIZE_RAD)
    things = [t for c in shown for t in c.shown if isinstance(t, VisibleThing)]
    owners = owners_of(things, look.found)
    return [
        (owner.id, owner.label) if owner is not None else (*_metre(d, look), "")
        for d, owner in zip(look.found, owners, strict=True)
    ]


def _metre(d: MeasuredDetection, look: MeasuredView) -> tuple[int, ...]:
    x0, y0, x1, y1 = d.box_px
    u, v, z = np.array([[(x0 + x1) / 2], [(y0 + y1) / 2], [d.depth_m]])
    p_world = world_points(u, v, z, look.camera, look.T_world_camera.matrix())[0]
    return tuple(np.floor(p_world).astype(int).tolist())


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
        slope = -sign * rows.weight * np.exp(-np.logaddexp(0.0, sign * eta))
        grad = np.zeros((len(classes) + 1, 2))
        np.add.at(grad, owner, slope[:, None] * columns[:, :2])
        gradient = np.concatenate([slope @ columns, grad[: len(classes)].ravel()])
        return float(-(rows.weight * log_p).sum() + 0.5 * ((w / sd) ** 2).sum()), gradient + w / sd**2

    w = minimize(loss, np.zeros(len(sd)), jac=True, method="L-BFGS-B", options={"maxiter": 1000}).x.round(3).tolist()
    even, slope, size, squared, far, camera = w[:n]
    by_class = {
        label: ClassTerms(w[n + 2 * i], w[n + 2 * i + 1], int((rows.label == label).sum()))
        for i, label in enumerate(classes)
    }
    return ChanceTable(source, even, slope, size, squared, far, camera, by_class)


def chances_of(table: ChanceTable, rows: Judged) -> Floats:
    """(N,) the table's chances."""
    return np.array(
        [table.chance_from_features(label, x) for label, x in zip(rows.label.tolist(), rows.x, strict=True)]
    )


def left_out(rows: Judged) -> Floats:
    """(N,) chances by tables that never saw the building."""
    chance = np.zeros(len(rows.right))
    fold = rows.building % _FOLDS
    for k in range(min(_FOLDS, len(set(rows.building.tolist())))):
        chance[fold == k] = chances_of(fit(rows.where(fold != k)), rows.where(fold == k))
    return chance


def expected_error(chance: Floats, right: NDArray[np.bool_], weight: Floats) -> float:
    """Expected calibration error (Naeini et al. 2015) over ``_BINS``."""
    at = np.clip(np.digitize(chance, _BINS) - 1, 0, len(_BINS) - 2)
    off = weight * (chance - right)
    return float(sum(abs(off[at == b].sum()) for b in range(len(_BINS) - 1)) / weight.sum())


def page(rows: Judged, chance: Floats, table: ChanceTable, backend: str = DEFAULT) -> str:
    """What it says, in Markdown."""
    targets = np.isin(rows.label, TARGETS)
    n_buildings = len(set(rows.building.tolist()))
    raw, table_s = (expected_error(values, rows.right, rows.weight) for values in (rows.score, chance))
    lines = [
        "# How likely a detection is right",
        "",
        f"Of what the table calls likely by p, about p is right. Each of {n_buildings} buildings was judged by a table of "
        f"others. The expected calibration error is {table_s:.3f}; of raw scores it is {raw:.3f}. A thing counts once, however "
        "many views show it.",
        "",
        f"Source: {table.source}. Fitted by `python -m surveilnav.benchmark.studies.calibration.chances"
        f"{'' if backend == DEFAULT else f' --backend {backend}'}`.",
        "",
        "| what | things | mean score | mean chance | right | Brier score: of scores | of chances |",
        "|---|---|---|---|---|---|---|",
    ]
    camera = rows.x[:, 4] > 0
    groups = {
        "all": np.ones(len(rows.right), bool),
        "the six targets": targets,
        "targets, robot views": targets & ~camera,
        "targets, camera views": targets & camera,
        **{label: rows.label == label for label in TARGETS},
    }
    for name, of in groups.items():
        if of.any():
            s, c, r, w = rows.score[of], chance[of], rows.right[of], rows.weight[of]
            score, mean, right, brier_s, brier_c = (_mean(v, w) for v in (s, c, r, (s - r) ** 2, (c - r) ** 2))
            lines.append(
                f"| {name} | {w.sum():.0f} | {score:.2f} | {mean:.2f} | {right:.2f} | {brier_s:.3f} | {brier_c:.3f} |"
            )
    lines += ["", "| chance | targets called so | mean chance | right |", "|---|---|---|---|"]
    for low, high in pairwise(_BINS.tolist()):
        of = targets & (chance >= low) & (chance < high)
        if of.any():
            w = rows.weight[of]
            lines.append(
                f"| {low:g} to {high:g} | {w.sum():.0f} | {_mean(chance[of], w):.2f} | {_mean(rows.right[of], w):.2f} |"
            )
    return "\n".join([*lines, ""])


def _mean(values: NDArray, weight: Floats) -> float:
    return float(np.average(values, weights=weight))


def main(argv: Sequence[str] | None = None) -> int:
    """Measures what isn't measured yet, fits, and writes table and page."""
    parser = argparse.ArgumentParser(
        prog="surveilnav.benchmark.studies.calibration.chances", description=__doc__.partition("\n")[0]
    )
    parser.add_argument("--backend", default=DEFAULT, help="what looks at the pictures; it has a vocabulary")
    parser.add_argument("--views", type=int, default=100, help="of the robot, about, in every building")
    parser.add_argument("--out", type=Path, help=f"{OUT}/chances.md, of other backends chances_<backend>.md")
    args = parser.parse_args(argv)
    try:
        buildings, model = looks_for(args.backend, args.views)
    except SurveilNavError as error:
        print(f"chances: {error}", file=sys.stderr)
        return 2
    rows = judged(buildings)
    names = ", ".join(b.name for b in buildings)
    n_views = sum(len(b.views) for b in buildings)
    table = fit(rows, f"{len(rows.right)} detections of {model} in {n_views} views of {names}")
    path = DATA / "chances" / f"{args.backend}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(msgspec.json.format(msgspec.json.encode(table), indent=1) + b"\n")
    out = args.out or OUT / ("chances.md" if args.backend == DEFAULT else f"chances_{args.backend}.md")
    out.write_text(page(rows, left_out(rows), table, args.backend), encoding="utf-8")
    return 0


def looks_for(name: str, n_views: int) -> tuple[list[MeasuredViews], str]:
    """What a backend found in the buildings that its chances are fitted in, measured where it isn't yet, and its detector.

    Raises:
        SurveilNavError: it can't run, finds only what it is asked for, or found nothing.
    """
    backend = None if name == DEFAULT else _with_vocabulary(name)
    scenes = [SceneSpec(building, 0, "train") for building in BUILDINGS_OF.get(name, BUILDINGS)]
    buildings = [measured(scene, n_views, backend) for scene in scenes]
    if not any(look.found for building in buildings for look in building.views):
        raise PerceptionError(f"{name} found nothing in any view")
    return buildings, name if backend is None else backend.models.detector


def _with_vocabulary(name: str) -> Backend:
    """The backend of a name. PerceptionError: it can't run, or finds only what it is asked for."""
    backend = choose_backend(name)
    if backend.vocabulary is None or backend.needs_truth:
        raise PerceptionError(f"expected a detector that looks at pixels and has a vocabulary, and {name} is none")
    return backend


if __name__ == "__main__":
    sys.exit(main())
