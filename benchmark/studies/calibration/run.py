"""Measures a real detector on rendered views of buildings with ``train``'s furniture and fits the backend ``simulated`` to it.

    python -m surveilnav.benchmark.studies.calibration [--buildings flats_1100 ...] [--views 240] [--models train] [--seed 0]
    python -m surveilnav.benchmark.studies.calibration --split val_mini [--views 120]

Every building is seen by its cameras and by a robot on a tour, pixels with baked light; what ``compact`` finds, in COCO's
words, of what each view truly shows goes to runs/calibration, building by building, and isn't measured again. Then the error
model is fitted to two thirds of the buildings and compared with the detector on the others, until every one was left
out once (docs/results/calibration); and fitted to all of them (data/simulated_errors.json; not with ``--dry``).

With ``--split`` nothing is fitted: the model in use is compared with the detector on the scenes of a split of the dataset
(docs/results/calibration/<split>). On those of ``val`` it has seen neither plans nor furniture.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from surveilnav.benchmark.dataset.splits import SPLITS, SceneSpec
from surveilnav.benchmark.studies.calibration import views
from surveilnav.benchmark.studies.calibration.fit import fit, matched
from surveilnav.benchmark.studies.calibration.in_coco_words import InCocoWords
from surveilnav.benchmark.studies.calibration.page import Side, compare
from surveilnav.benchmark.studies.calibration.plots import plots
from surveilnav.benchmark.studies.calibration.tour import Tour, views_on
from surveilnav.errors import SurveilNavError
from surveilnav.perception.backend import Backend
from surveilnav.perception.vocabulary import COCO
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.simulator.truth import error_model
from surveilnav.simulator.truth.choose import choose_backend
from surveilnav.simulator.truth.error_model import ErrorModel

#: ``compact`` learnt from views of all buildings of ``train``; these it never saw, only their furniture models.
UNSEEN = tuple(f"{kind}_{n}" for n in range(1100, 1104) for kind in ("flats", "office"))
FOLDS = 3
CAMERAS = 4
ROUNDS = 5  # of bringing what is drawn to what was measured
OUT = Path("docs/results/calibration")
DATA = Path("runs/calibration")
MODEL = Path(error_model.__file__).parent / "data" / "simulated_errors.json"
_ROW = re.compile(r"\[[^\[\]{}]*\]")  # of numbers: kept on one line


def measured(scene: SceneSpec, n_views: int, backend: Backend | None = None) -> views.MeasuredViews:
    """The looks of one building: kept ones, or new ones. ``backend``: that looked; None: ``onnx-coco``."""
    name = scene.building
    folder = DATA if backend is None else DATA / backend.models.detector  # which names the weights
    path = folder / f"{name}-s{scene.seed}-{scene.models}-{n_views}.looks"
    kept = views.load(path)
    if kept is not None:
        return kept
    began_s = time.monotonic()

    def progress(done: int, of: int) -> None:
        left_s = (time.monotonic() - began_s) / done * (of - done)
        print(f"\r{name}: {done} of {of} views, about {left_s:.0f} s left ", end="", file=sys.stderr, flush=True)

    settings = SimulationSettings(building=name, seed=scene.seed, models=scene.models, cameras=CAMERAS)
    building = SimulatedBuilding(settings)
    backend = backend or choose_backend("onnx-coco")
    seen = views_on(building, backend, Tour(n_views, math.radians(30.0), 0.5), progress)
    looks = views.measured_views_of(name, seen, building, backend.vocabulary or COCO)
    path.parent.mkdir(parents=True, exist_ok=True)
    views.save(looks, path)
    print(file=sys.stderr)
    return looks


def fitted(buildings: Sequence[views.MeasuredViews], args: argparse.Namespace, detector: str) -> ErrorModel:
    """The model of some buildings."""
    rows = views.rows_of(buildings)
    n_camera = sum(look.is_camera for building in buildings for look in building.views)
    n = sum(len(building.views) for building in buildings)
    names = ", ".join(building.name for building in buildings)
    counts = ", ".join(f"{len(r.ids)} {kind}s, {int(r.found.sum())} found" for kind, r in rows.items())
    source = (
        f"python -m surveilnav.benchmark.studies.calibration --seed {args.seed} --models {args.models} --views {args.views}: "
        f"{detector} on {n - n_camera} robot views and {n_camera} camera views of {names}; {counts}"
    )
    model = fit(rows, presence_of(buildings), source)
    for seed in range(100, 100 + ROUNDS):
        drawn = [views.simulated(building, model, seed)[0] for building in buildings]
        model = matched(model, rows, views.rows_of(buildings, drawn))
    return model


def presence_of(buildings: Sequence[views.MeasuredViews]) -> np.ndarray:
    """How surely each class is in each view by the view's embedding: (V, 80) float32, 0 to 1, of all V views of the
    buildings in order. The 80 columns are COCO's classes (``class_space.presence``)."""
    return np.array([look.presence for building in buildings for look in building.views], np.float32)


def main(argv: Sequence[str] | None = None) -> int:
    """Measures what isn't measured yet, fits unless --split, and writes the page; 2: it can't be."""
    args = _parser().parse_args(argv)
    scenes = [SceneSpec(name, args.seed, args.models) for name in args.buildings]
    if args.split:
        scenes = list({s.building: s for s in SPLITS[args.split].scenes}.values())  # looks go by building: each once
    elif len(scenes) < FOLDS:
        print(f"calibration: give at least {FOLDS} buildings: each is compared with a model of others", file=sys.stderr)
        return 2
    try:
        backend = InCocoWords()
        buildings = [measured(scene, args.views, backend) for scene in scenes]
    except SurveilNavError as error:
        print(f"calibration: {error}", file=sys.stderr)
        return 2
    model, unseen, about = (
        _in_use(buildings, args) if args.split else _left_out(buildings, args, backend.models.segmenter)
    )
    real, sims = Side.real(buildings), [Side.simulated(buildings, unseen, seed) for seed in range(4)]
    out = args.out or (OUT / args.split if args.split else OUT)
    out.mkdir(parents=True, exist_ok=True)
    page = compare(real, sims, model, about)
    (out / "README.md").write_text(page, encoding="utf-8")
    plots(real, sims, out)
    print(page)
    if not (args.dry or args.split):
        text = msgspec.json.format(msgspec.json.encode(model), indent=1).decode()
        MODEL.write_text(_ROW.sub(lambda row: re.sub(r"\s+", " ", row[0]), text) + "\n", encoding="utf-8")
    return 0


_Compared = tuple[ErrorModel, dict[str, ErrorModel], str]


def _in_use(buildings: Sequence[views.MeasuredViews], args: argparse.Namespace) -> _Compared:
    """The model in use, that of each building, and a word for the page."""
    model = error_model.error_model()
    about = (
        f"Made by `python -m surveilnav.benchmark.studies.calibration --split {args.split} --views {args.views}`. "
        f"The model in use, fitted to the buildings of the source, is compared with the detector on the scenes of `{args.split}`."
    )
    return model, dict.fromkeys((building.name for building in buildings), model), about


def _left_out(buildings: Sequence[views.MeasuredViews], args: argparse.Namespace, detector: str) -> _Compared:
    """A model of all buildings, for each building one of others, and a word for the page."""
    unseen = {}
    for fold in range(FOLDS):
        model = fitted([building for i, building in enumerate(buildings) if i % FOLDS != fold], args, detector)
        unseen.update({building.name: model for building in buildings[fold::FOLDS]})
    about = "Every building is compared with a model of other buildings. The committed model is fitted to all."
    return fitted(buildings, args, detector), unseen, about


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="surveilnav.benchmark.studies.calibration.run", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("--buildings", nargs="+", default=list(UNSEEN))
    parser.add_argument("--views", type=int, default=240, help="of the robot, about, in every building")
    parser.add_argument("--models", choices=("all", "train", "val"), default="train")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--split", choices=tuple(SPLITS), help="fit nothing: compare the model in use on these scenes")
    parser.add_argument("--out", type=Path, help=f"{OUT}, with --split the folder of its name therein")
    parser.add_argument("--dry", action="store_true", help="don't replace the committed model")
    return parser


if __name__ == "__main__":
    sys.exit(main())
