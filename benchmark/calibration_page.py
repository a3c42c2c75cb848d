"""How alike the backend ``simulated`` and the real detector are on homes that the model wasn't fitted to."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmark.calibration_fit import MIN_SCORE, apart, pairs_of
from benchmark.calibration_views import Looks, Rows, rows_of, simulated
from surveilnav.categories import TARGETS
from surveilnav.perception import closed_set
from surveilnav.perception.error_model import FEATURES, ErrorModel, Floats

_NEAR_CHORD, _NEAR_M = 0.52, 1.0  # 30 degrees
_CHORDS = (0.0, 0.1, 0.25, 0.5, 0.8, 1.2, 2.0)
_RANGES_M = (0.0, 1.0, 1.5, 2.0, 3.0, 4.0, 5.5, 13.0)
_SIZES_MRAD = (20, 50, 100, 150, 220, 320, 500, 2000)


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """What one detector, real or simulated, made of the same views. ``presence``: (views, 80)."""

    rows: dict[str, Rows]
    presence: NDArray[np.float32]
    is_camera: NDArray[np.bool_]

    @classmethod
    def real(cls, homes: Sequence[Looks]) -> Side:
        looks = [look for home in homes for look in home.looks]
        presence = np.array([look.presence for look in looks], np.float32)
        return cls(rows_of(homes), presence, np.array([look.is_camera for look in looks]))

    @classmethod
    def simulated(cls, homes: Sequence[Looks], models: Mapping[str, ErrorModel], seed: int) -> Side:
        """By the model of each home."""
        seen = [simulated(home, models[home.name], seed) for home in homes]
        is_camera = np.array([look.is_camera for home in homes for look in home.looks])
        return cls(rows_of(homes, [found for found, _ in seen]), np.concatenate([p for _, p in seen]), is_camera)

    def false(self, camera: bool) -> Counter[str]:
        """Wrong names of targets, by name, in robots' or cameras' views."""
        names: list[str] = []
        for rows in self.rows.values():
            names += rows.name[rows.found & ~rows.right & (self.is_camera[rows.view] == camera)].tolist()
        return Counter(n for n in names if n in TARGETS)

    def repeated(self) -> tuple[float, int]:
        """The share of false targets that another view within 1 m and 30 degrees repeats, and how many such pairs."""
        same = n = 0
        for rows in self.rows.values():
            pairs = _near(rows, 10_000_000)
            for a, b in (pairs.T, pairs[:, ::-1].T):
                false = (rows.found & ~rows.right & np.isin(rows.name, TARGETS))[a]
                n += int(false.sum())
                same += int((rows.name[a] == rows.name[b])[false].sum())
        return same / max(1, n), n

    def agreement(self, kind: str) -> tuple[float, float]:
        """P(found | found in another near view), and what independent views would give (the finders' mean chance)."""
        rows = self.rows[kind]
        pairs = _near(rows, 10_000_000)
        both, either = rows.found[pairs[:, 0]] & rows.found[pairs[:, 1]], rows.found[pairs].sum()
        return float(2 * both.sum() / max(1, either)), float(rows.found[pairs].mean())

    def values(self) -> Floats:
        """(views, 6) cosine of every view with the text of every target."""
        images = np.concatenate([self.presence, np.full((len(self.presence), 1), 0.3, np.float32)], axis=1)
        images /= np.linalg.norm(images, axis=1, keepdims=True)
        texts = closed_set.embed_texts([f"seems like there is a {target}" for target in TARGETS])
        return np.asarray(images @ texts.T, np.float64)


def _near(rows: Rows, most: int) -> NDArray[np.int64]:
    pairs = pairs_of(rows, np.random.default_rng(0), most)
    chord, _ = apart(rows, pairs)
    a, b = pairs.T
    return pairs[(chord <= _NEAR_CHORD) & (np.abs(rows.range_m[a] - rows.range_m[b]) <= _NEAR_M)]


def correlations(side: Side, model: ErrorModel, kind: str) -> list[tuple[float, float]]:
    """(correlation of the luck of finding, pairs) by the chord between two views of an instance at like ranges."""
    rows = side.rows[kind]
    pairs = pairs_of(rows, np.random.default_rng(0), 400_000)
    chord, ratio = apart(rows, pairs)
    from scipy.special import ndtr

    p = ndtr(model.kinds[kind].ease(rows.x, rows.labels))
    left = (rows.found - p) / np.sqrt(p * (1 - p))
    out = []
    for low, high in itertools.pairwise(_CHORDS):
        near = (chord >= low) & (chord < high) & (ratio < 0.25)
        a, b = pairs[near].T
        out.append((float((left[a] * left[b]).mean()) if near.any() else float("nan"), float(near.sum())))
    return out


def compare(real: Side, sims: Sequence[Side], model: ErrorModel) -> str:
    """The page."""

    def mean(of: Callable[[Side], float]) -> tuple[float, float, float]:
        values = [of(s) for s in sims]
        return float(np.mean(values)), float(np.min(values)), float(np.max(values))

    def row(name: str, of: Callable[[Side], float], digits: int = 2, n: str = "") -> str:
        m, low, high = mean(of)
        return f"| {name} | {n} | {of(real):.{digits}f} | {m:.{digits}f} ({low:.{digits}f}–{high:.{digits}f}) |"

    things = real.rows["thing"]
    lines = [
        "# The simulated detector against the real one",
        "",
        f"`{model.source}`.",
        "",
        f"Every home is compared with a model of other homes: {int((~real.is_camera).sum())} robot views and "
        f"{int(real.is_camera.sum())} camera views. Real: `onnx-coco` on pixels. Simulated: mean of {len(sims)} seeds "
        "(least–most). Furniture models are those of the train half; the committed model is fitted to all homes.",
        "",
        "![reliability](reliability.png)",
        "![luck, scores, false alarms, value](behaviour.png)",
        "",
        "## Found, and called by its own name",
        "",
        "| class | visible | real | simulated |",
        "|---|---|---|---|",
    ]
    for label in TARGETS:
        m = things.labels == label
        lines.append(
            row(
                label,
                lambda s, m=m: float((s.rows["thing"].right & s.rows["thing"].found)[m].mean()),
                n=str(int(m.sum())),
            )
        )  # type: ignore[misc]
    for name, camera in (("targets, robot views", False), ("targets, camera views", True)):
        m = np.isin(things.labels, TARGETS) & (real.is_camera[things.view] == camera)
        lines.append(
            row(
                name,
                lambda s, m=m: float((s.rows["thing"].right & s.rows["thing"].found)[m].mean()),
                n=str(int(m.sum())),
            )
        )  # type: ignore[misc]
    lines += [
        "",
        "## False targets, persistence, value",
        "",
        "| measure | pairs | real | simulated |",
        "|---|---|---|---|",
    ]
    for name, camera in (("false targets a robot view", False), ("false targets a camera view", True)):
        lines.append(row(name, lambda s, c=camera: sum(s.false(c).values()) / max(1, (s.is_camera == c).sum())))  # type: ignore[misc]
    lines.append(
        row(
            "a second view within 1 m and 30° repeats a false target",
            lambda s: s.repeated()[0],
            n=str(real.repeated()[1]),
        )
    )
    for kind, name in (("thing", "things with a name"), ("other", "things without"), ("place", "walls and floors")):
        lines.append(row(f"{name}: found again in a near view", lambda s, k=kind: s.agreement(k)[0]))  # type: ignore[misc]
        lines.append(row(f"{name}: … if views were independent", lambda s, k=kind: s.agreement(k)[1]))  # type: ignore[misc]
    lines.append(row("mean score of right names", lambda s: float(s.rows["thing"].score[_right(s)].mean())))
    lines.append(row("mean score of false targets", lambda s: float(np.mean(_false_scores(s)))))
    for q in (0.1, 0.5, 0.9):
        lines.append(
            row(
                f"value (cosine of view and target), {q:.0%} quantile",
                lambda s, q=q: float(np.quantile(s.values(), q)),
                3,
            )
        )  # type: ignore[misc]
    lines.append(
        row(
            "value, correlation with the real one",
            lambda s: float(np.corrcoef(s.values().ravel(), real.values().ravel())[0, 1]),
        )
    )
    return "\n".join(lines) + "\n"


def _right(side: Side) -> NDArray[np.bool_]:
    rows = side.rows["thing"]
    return rows.found & rows.right & np.isin(rows.labels, TARGETS)


def _false_scores(side: Side) -> Floats:
    parts = [r.score[r.found & ~r.right & np.isin(r.name, TARGETS)] for r in side.rows.values()]
    return np.concatenate([*parts, np.array([MIN_SCORE])])


# --- pictures -----------------------------------------------------------------------------------------------------


def plots(real: Side, sims: Sequence[Side], model: ErrorModel, out: Path) -> None:
    """reliability.png and behaviour.png."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(3, 6, figsize=(18, 9), sharey=True)
    hidden = FEATURES.index("hidden")
    measures: Iterable[tuple[str, Sequence[float], Callable[[Rows], Floats]]] = (
        ("distance [m]", _RANGES_M, lambda r: r.range_m),
        ("visible size [mrad]", _SIZES_MRAD, lambda r: 150 * np.exp(r.x[:, FEATURES.index("size")])),
        ("share of outline hidden", (0.0, 0.1, 0.25, 0.4, 0.6, 0.8, 1.01), lambda r: r.x[:, hidden]),
    )
    for line, (name, edges, of) in zip(axes, measures, strict=True):
        for axis, label in zip(line, TARGETS, strict=True):
            _reliability(axis, label, edges, of, real, sims)
            axis.set_xlabel(name)
            axis.set_title(label if line is axes[0] else "")
    axes[0, 0].legend(fontsize=8)
    axes[0, 0].set_ylim(0, 1.02)
    for line in axes:
        line[0].set_ylabel("found under its name")
    figure.tight_layout()
    figure.savefig(out / "reliability.png", dpi=75)

    figure, ((a, b, c), (d, e, f)) = pyplot.subplots(2, 3, figsize=(16, 8.5))
    for axis, kind in ((a, "thing"), (b, "other")):
        _luck(axis, kind, real, sims, model)
    bins = np.linspace(MIN_SCORE, 1.0, 16)
    for axis, title, of_scores in (
        (c, "scores of right names", lambda s: s.rows["thing"].score[_right(s)]), (d, "scores of false targets", _false_scores),
    ):  # fmt: skip
        axis.hist(of_scores(real), bins, density=True, alpha=0.5, label="real")
        axis.hist(
            np.concatenate([of_scores(s) for s in sims]), bins, density=True, histtype="step", lw=2, label="simulated"
        )
        axis.set_title(title)
        axis.legend()
    at = np.arange(len(TARGETS))
    for shift, camera in ((-0.3, False), (0.1, True)):
        n = max(1, int((real.is_camera == camera).sum()))
        kind = "camera" if camera else "robot"
        e.bar(at + shift, [real.false(camera)[t] / n for t in TARGETS], 0.18, label=f"real, {kind}")
        rates = [[s.false(camera)[t] / n for t in TARGETS] for s in sims]
        e.bar(at + shift + 0.18, np.mean(rates, axis=0), 0.18, label=f"simulated, {kind}", alpha=0.6)
    e.set_xticks(at, TARGETS, rotation=20)
    e.set_title("false targets a view")
    e.legend(fontsize=8)
    for side, name in ((real, "real"), (sims[0], "simulated")):
        f.plot(np.sort(side.values().ravel()), np.linspace(0, 1, side.values().size), label=name)
    f.set_title("value of a view for a target: cumulative")
    f.legend()
    figure.tight_layout()
    figure.savefig(out / "behaviour.png", dpi=75)


def _reliability(
    axis, label: str, edges: Sequence[float], of: Callable[[Rows], Floats], real: Side, sims: Sequence[Side]
) -> None:  # type: ignore[no-untyped-def]
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


def _luck(axis, kind: str, real: Side, sims: Sequence[Side], model: ErrorModel) -> None:  # type: ignore[no-untyped-def]
    middle = [(low + high) / 2 for low, high in itertools.pairwise(_CHORDS)]
    axis.plot(middle, [r for r, _ in correlations(real, model, kind)], "o-", label="real")
    values = np.array([[r for r, _ in correlations(s, model, kind)] for s in sims])
    axis.plot(middle, values.mean(axis=0), "C1", label="simulated")
    axis.fill_between(middle, values.min(axis=0), values.max(axis=0), color="C1", alpha=0.2)
    axis.set_title(f"correlation of finding in two views: {kind}")
    axis.set_xlabel("chord between the directions of sight (0.52: 30°)")
    axis.set_ylim(-0.1, 0.8)
    axis.legend()
