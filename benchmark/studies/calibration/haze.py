"""What a detector's weak scores make of classes that a view doesn't show, as a part of the error model."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import rankdata

from surveilnav.benchmark.studies.calibration.views import OutcomeTable
from surveilnav.perception.vocabulary import COCO
from surveilnav.simulator.truth.error_model import FEATURES, Floats, Haze, showing

_RIDGE = 30.0


def fit_haze(rows: dict[str, OutcomeTable], unsaid: NDArray[np.float32]) -> dict[str, Haze]:
    """What weak scores make of classes that a view neither shows nor says, where they make anything: normal scores of it
    by ridge regression on what shows."""
    things = rows["thing"]
    left = unsaid.copy()
    left[things.view, [COCO.index(label) for label in things.labels]] = np.nan
    labels, shown, camera = _shown(rows, len(unsaid))
    x = np.column_stack([shown, camera])
    haze = {}
    for i, name in enumerate(COCO):
        there = np.isfinite(left[:, i])
        quantiles = np.quantile(left[there, i], np.linspace(0, 1, 9)) if there.any() else np.zeros(9)
        if quantiles[6] < 0.04:
            continue
        normal = ndtri((rankdata(left[there, i]) - 0.5) / there.sum())
        mean = x[there].mean(axis=0)
        centred = x[there] - mean
        w = np.linalg.solve(centred.T @ centred + _RIDGE * np.eye(x.shape[1]), centred.T @ normal)
        rest = max(0.05, 1.0 - float((centred @ w).var()))
        beside = {label: round(float(v), 3) for label, v in zip(labels, w[:-1], strict=True)}
        haze[name] = Haze(rounded(quantiles), beside, *rounded([w[-1], mean @ w, np.sqrt(rest)]))
    return haze


def _shown(rows: dict[str, OutcomeTable], n_views: int) -> tuple[list[str], Floats, Floats]:
    """Labels, how large things of each show in each view (views, labels), and whether it is a camera's."""
    seen = [rows[kind] for kind in ("thing", "other") if kind in rows]
    labels = sorted({label for r in seen for label in r.classes})
    shown, camera = np.zeros((n_views, len(labels))), np.zeros(n_views)
    column = {label: i for i, label in enumerate(labels)}
    for r in seen:
        camera[r.view] = r.x[:, FEATURES.index("camera")]
        named = np.flatnonzero(r.labels != "")
        for there in np.split(named, np.flatnonzero(np.diff(r.view[named])) + 1):  # rows of a view are side by side
            for label, clear in showing(r.labels[there].tolist(), r.x[there]).items():
                shown[r.view[there[0]], column[label]] = clear
    return labels, shown, camera


def rounded(values: Iterable[float]) -> list[float]:
    """Values as they are written in the error model."""
    return [round(float(v), 3) for v in values]
