"""Learns what lies beyond frontiers, and holds it against simpler rules on buildings that it never saw.

    python -m training.places.train --rows data/places_rows --out services/planner/core/places/places.onnx

First the gate, offline: five folds of generated buildings, and real homes one by one, each predicted by a model of all other
buildings. Then one model of everything is written.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score
from sklearn.neural_network import MLPClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from surveilnav.benchmark.dataset.splits import is_real_home
from surveilnav.services.planner.core.places.features import GEOMETRY, names, of_target
from surveilnav.services.planner.core.places.rule import expected_way_m
from surveilnav.simulator.world.labels import TARGETS
from training.places.rows import CONFIRMED, LABELS
from training.places.trees import to_onnx

WITHIN_M = (2.5, 5.0, 10.0, 20.0)
#: The gate asks whether the target lies within this beyond a frontier.
_GATE_M = 5.0
_N_FOLDS = 5
_SEED = 0


@dataclass(frozen=True, eq=False)
class Rows:
    """Frontiers in states, for targets.

    Attributes:
        x: (n, k) inputs of the model. ``left_m``: (n,) the true way beyond.
        state: (n,) numbers of pairs of a state and a target. ``scene``: (n,) indices into ``scenes``.
        is_searched: (n,) whether the target is the one that the search was for.
    """

    x: NDArray[np.float32]
    left_m: NDArray[np.float64]
    state: NDArray[np.int64]
    scene: NDArray[np.int64]
    is_searched: NDArray[np.bool_]
    scenes: tuple[str, ...]

    @property
    def weight(self) -> NDArray[np.float64]:
        """(n,) so that each state counts the same."""
        return 1.0 / np.bincount(self.state)[self.state]


def load(folder: Path, every: int = 1) -> Rows:
    """The rows of one of ``every`` states. Targets that aren't in a building, or that are confirmed already, are left out."""
    parts: list[tuple[Any, ...]] = []
    files = sorted(folder.glob("*.npz"))
    n_states = 0
    for n_scene, path in enumerate(files):
        with np.load(path) as file:
            features, left, chance, state, searched = (
                file[name] for name in ("features", "left_m", "chance", "state", "searched")
            )
        for i, target in enumerate(TARGETS):
            ok = np.isfinite(left[:, i]) & (chance[:, i] < CONFIRMED) & (state % every == 0)
            if ok.any():
                x = np.concatenate(
                    [
                        of_target(
                            features[ok & (state == s)], LABELS, TARGETS, target, float(chance[ok & (state == s), i][0])
                        )
                        for s in np.unique(state[ok])
                    ]
                )
                order = np.argsort(state[ok], kind="stable")
                of = (state[ok][order].astype(np.int64) + n_states) * len(TARGETS) + i
                parts.append((x, left[ok, i][order], of, np.full(len(x), n_scene), searched[ok][order] == i))
        n_states += int(state.max()) + 1
    x, left_m, state, scene, is_searched = (np.concatenate(column) for column in zip(*parts, strict=True))
    state = np.unique(state, return_inverse=True)[1].ravel()
    return Rows(x, left_m.astype(np.float64), state, scene, is_searched, tuple(p.stem for p in files))


class Predictor(Protocol):
    """Chances of ``WITHIN_M``: fitted on some rows, asked for others."""

    def fit(self, x: NDArray[np.float32], left_m: NDArray[np.float64], weight: NDArray[np.float64]) -> Predictor: ...
    def predict(self, x: NDArray[np.float32]) -> NDArray[np.float64]: ...


class OneEach:
    """A classifier for each distance. ``columns``: which inputs it is given, all if None."""

    def __init__(self, make: Callable[[], Any], columns: Sequence[int] | None = None, *, weighs: bool = True) -> None:
        self._make, self._columns, self._weighs = make, columns, weighs
        self.models: list[Any] = []

    def fit(self, x: NDArray[np.float32], left_m: NDArray[np.float64], weight: NDArray[np.float64]) -> OneEach:
        more = {"sample_weight": weight} if self._weighs else {}
        self.models = [self._make().fit(self._of(x), left_m <= within, **more) for within in WITHIN_M]
        return self

    def predict(self, x: NDArray[np.float32]) -> NDArray[np.float64]:
        return np.maximum.accumulate(
            np.stack([m.predict_proba(self._of(x))[:, 1] for m in self.models], axis=1), axis=1
        )

    def _of(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        return x if self._columns is None else x[:, self._columns]


def trees() -> HistGradientBoostingClassifier:
    """Boosted trees, small enough for 10 ms a decision."""
    return HistGradientBoostingClassifier(
        max_iter=150,
        learning_rate=0.08,
        max_leaf_nodes=20,
        min_samples_leaf=150,
        l2_regularization=10.0,
        max_features=0.4,
        early_stopping=False,
        random_state=_SEED,
    )


def _network() -> Any:
    return make_pipeline(
        StandardScaler(), MLPClassifier((64, 32), alpha=1e-2, max_iter=12, batch_size=1024, random_state=_SEED)
    )


def _logistic() -> Any:
    return make_pipeline(StandardScaler(), LogisticRegression(C=0.1, max_iter=300))


_N_GEOMETRY, _N_INPUTS = len(GEOMETRY), len(names(LABELS, TARGETS))
IDEAS: dict[str, Callable[[], OneEach]] = {
    "boosted trees": lambda: OneEach(trees),
    "boosted trees, without objects": lambda: OneEach(trees, [*range(_N_GEOMETRY), *range(-len(TARGETS), 0)]),
    "boosted trees, without geometry": lambda: OneEach(trees, [0, *range(_N_GEOMETRY, _N_INPUTS)]),
    "network of two layers": lambda: OneEach(_network, weighs=False),
    "logistic regression": lambda: OneEach(_logistic, weighs=False),
}


def folds_of(rows: Rows) -> NDArray[np.int64]:
    """(n,) the fold that a row is held out in: generated buildings in five, each real home in its own."""
    buildings = [s.rpartition("-s")[0] for s in rows.scenes]
    homes = sorted({b for b, s in zip(buildings, rows.scenes, strict=True) if is_real_home(s)})
    generated = [b for b in buildings if b not in homes]
    fold = {b: i % _N_FOLDS for i, b in enumerate(sorted(set(generated)))} | {
        b: _N_FOLDS + i for i, b in enumerate(homes)
    }
    return np.array([fold[b] for b in buildings])[rows.scene]


def held_out(rows: Rows, make: Callable[[], OneEach]) -> NDArray[np.float64]:
    """(n, k) chances, each by a model of the other folds."""
    folds, chances = folds_of(rows), np.zeros((len(rows.x), len(WITHIN_M)))
    for fold in np.unique(folds):
        rest, here = folds != fold, folds == fold
        chances[here] = make().fit(rows.x[rest], rows.left_m[rest], rows.weight[rest]).predict(rows.x[here])
    return chances


def measures(rows: Rows, likely: NDArray[np.float64], cost: NDArray[np.float64], among: NDArray[np.bool_]) -> str:
    """A table's cells: the AUC of "the target is within 5 m beyond", over all frontiers and within a state, and mean regret [m].

    Args:
        likely: (n,) the higher, the likelier. ``cost``: (n,) in each state the frontier of the lowest is taken; its regret is how
            much longer the way over it is than over the best one.
    """
    is_near = rows.left_m <= _GATE_M
    way_m = np.minimum(rows.x[:, 0] + rows.left_m, 60.0)
    order = np.argsort(rows.state, kind="stable")
    states = np.split(order, np.flatnonzero(np.diff(rows.state[order])) + 1)
    within, regret = [], []
    for s in states:
        if not among[s[0]] or len(s) < 2:
            continue
        regret.append(way_m[s[np.argmin(cost[s])]] - way_m[s].min())
        if 0 < is_near[s].sum() < len(s):
            within.append(roc_auc_score(is_near[s], likely[s]))
    overall = roc_auc_score(is_near[among], likely[among])
    return f"{overall:.3f} | {np.mean(within):.3f} | {np.mean(regret):.2f} | {len(regret)}"


def gate(rows: Rows, ideas: Sequence[str]) -> None:
    """Prints the offline table, apart for generated buildings and real homes."""
    real = np.array([is_real_home(s) for s in rows.scenes])[rows.scene]
    travel = rows.x[:, 0].astype(np.float64)
    rules: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]] = {"nearest first": (-travel, travel)}
    width = 0.5 + 0.5 * np.minimum(1.0, rows.x[:, 2].astype(np.float64))
    rules["width per metre (ours without values)"] = width, -width / (travel + 3.0)
    for name in ideas:
        chances = held_out(rows, IDEAS[name])
        rules[f"{name}, least way"] = chances[:, 1], travel + expected_way_m(chances, np.array(WITHIN_M))
        rules[f"{name}, chance per metre"] = chances[:, 1], -chances[:, 1] / (travel + 3.0)
        print(f"{name}: done", flush=True)
    for where, here in (("generated buildings", ~real), ("real homes", real)):
        for what, of in (("all targets", here), ("the search's target", here & rows.is_searched)):
            n = len(np.unique(rows.scene[here]))
            print(
                f"\n{where} ({n} scenes), {what}\n| rule | AUC | within a state | regret [m] | states |\n|---|---|---|---|---|"
            )
            if of.any():
                for name, (likely, cost) in rules.items():
                    print(f"| {name} | {measures(rows, likely, cost, of)} |", flush=True)


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--rows", type=Path, required=True)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--every", type=int, default=1, help="use only one of so many states, which are alike")
    parser.add_argument("--ideas", nargs="*", default=list(IDEAS))
    a = parser.parse_args(argv)
    rows = load(a.rows, a.every)
    print(f"{len(rows.x)} rows of {rows.state.max() + 1} states, {len(rows.scenes)} scenes", flush=True)
    if a.ideas:
        gate(rows, a.ideas)
    if a.out:
        model = IDEAS["boosted trees"]().fit(rows.x, rows.left_m, rows.weight)
        about = {"within_m": WITHIN_M, "targets": TARGETS, "labels": LABELS, "scenes": len(rows.scenes)}
        a.out.write_bytes(to_onnx(model.models, rows.x.shape[1], {"places": json.dumps(about)}))
        print(f"{a.out}: {a.out.stat().st_size} bytes")


if __name__ == "__main__":
    main()
