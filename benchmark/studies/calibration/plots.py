"""Pictures of the simulated detector beside the real one."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from surveilnav.benchmark.studies.calibration.fit import MIN_SCORE
from surveilnav.benchmark.studies.calibration.page import BANDS, CHORDS, Side, correlations
from surveilnav.benchmark.studies.calibration.views import OutcomeTable
from surveilnav.simulator.truth.error_model import Floats
from surveilnav.simulator.world.labels import TARGETS


def plots(real: Side, sims: Sequence[Side], out: Path) -> None:
    """reliability.png and behaviour.png."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(len(BANDS), len(TARGETS), figsize=(18, 3 * len(BANDS)), sharey=True)
    for line, (name, edges, of) in zip(axes, BANDS, strict=True):
        for axis, label in zip(line, TARGETS, strict=True):
            _reliability(axis, label, edges, of, real, sims)
            axis.set_xlabel(name)
    for axis, label in zip(axes[0], TARGETS, strict=True):
        axis.set_title(label)
    axes[0, 0].legend(fontsize=8)
    axes[0, 0].set_ylim(0, 1.02)
    for line in axes:
        line[0].set_ylabel("found under its name")
    figure.tight_layout()
    figure.savefig(out / "reliability.png", dpi=75)

    figure, ((a, b, c), (d, e, f)) = pyplot.subplots(2, 3, figsize=(16, 8.5))
    _luck(a, "thing", real, sims)
    _luck(b, "other", real, sims)
    _scores(c, "scores of right names", Side.right_scores, real, sims)
    _scores(d, "scores of false targets", Side.false_scores, real, sims)
    _false_rates(e, real, sims)
    for side, name in ((real, "real"), (sims[0], "simulated")):
        f.plot(np.sort(side.values().ravel()), np.linspace(0, 1, side.values().size), label=name)
    f.set_title("value of a view for a target: cumulative")
    f.legend()
    figure.tight_layout()
    figure.savefig(out / "behaviour.png", dpi=75)


def _scores(axis: Any, title: str, of: Callable[[Side], Floats], real: Side, sims: Sequence[Side]) -> None:
    bins = np.linspace(MIN_SCORE, 1.0, 16)
    axis.hist(of(real), bins, density=True, alpha=0.5, label="real")
    axis.hist(np.concatenate([of(s) for s in sims]), bins, density=True, histtype="step", lw=2, label="simulated")
    axis.set_title(title)
    axis.legend()


def _false_rates(axis: Any, real: Side, sims: Sequence[Side]) -> None:
    at = np.arange(len(TARGETS))
    for shift, camera in ((-0.3, False), (0.1, True)):
        seen = real.is_camera == camera
        n = max(1, int(seen.sum()))
        kind = "camera" if camera else "robot"
        axis.bar(at + shift, [real.false(seen)[t] / n for t in TARGETS], 0.18, label=f"real, {kind}")
        rates = [[s.false(seen)[t] / n for t in TARGETS] for s in sims]
        axis.bar(at + shift + 0.18, np.mean(rates, axis=0), 0.18, label=f"simulated, {kind}", alpha=0.6)
    axis.set_xticks(at, TARGETS, rotation=20)
    axis.set_title("false targets a view")
    axis.legend(fontsize=8)


def _reliability(
    axis: Any,
    label: str,
    edges: Sequence[float],
    of: Callable[[OutcomeTable], Floats],
    real: Side,
    sims: Sequence[Side],
) -> None:
    rows = real.rows["thing"]
    values, keep = of(rows), rows.labels == label
    cell = np.digitize(values, edges[1:-1])
    xs, reals, sds, ns, lows, highs, means = [], [], [], [], [], [], []
    for i in range(len(edges) - 1):
        m = keep & (cell == i)
        n = int(m.sum())
        if n < 5:
            continue
        shares = [float((s.rows["thing"].found & s.rows["thing"].right)[m].mean()) for s in sims]
        share = float((rows.found & rows.right)[m].mean())
        xs.append(float(np.median(values[m])))
        reals.append(share)
        sds.append(float(np.sqrt(max(share * (1 - share), 0.25 / n) / n)))
        ns.append(n)
        means.append(float(np.mean(shares)))
        lows.append(min(shares))
        highs.append(max(shares))
    axis.errorbar(xs, reals, sds, fmt="o", label="real ± 1 sd")
    axis.plot(xs, means, color="C1", label="simulated")
    axis.fill_between(xs, lows, highs, color="C1", alpha=0.2)
    for x, y, n in zip(xs, reals, ns, strict=True):
        axis.annotate(str(n), (x, y), fontsize=6, xytext=(3, 3), textcoords="offset points")


def _luck(axis: Any, kind: str, real: Side, sims: Sequence[Side]) -> None:
    middle = [(low + high) / 2 for low, high in itertools.pairwise(CHORDS)]
    axis.plot(middle, [r for r, _ in correlations(real, kind)], "o-", label="real")
    values = np.array([[r for r, _ in correlations(s, kind)] for s in sims])
    axis.plot(middle, values.mean(axis=0), "C1", label="simulated")
    axis.fill_between(middle, values.min(axis=0), values.max(axis=0), color="C1", alpha=0.2)
    axis.set_title(f"correlation of finding in two views: {kind}")
    axis.set_xlabel("chord between the directions of sight (0.52: 30°)")
    axis.set_ylim(-0.1, 0.8)
    axis.legend()
