"""How alike the backend ``simulated`` and the real detector are on buildings that the model wasn't fitted to."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from surveilnav.benchmark.studies.calibration.fit import apart, fit_probit, pairs_of
from surveilnav.benchmark.studies.calibration.views import MeasuredViews, OutcomeTable, rows_of, simulated
from surveilnav.perception.embedders import class_space
from surveilnav.perception.prompts import value_prompt
from surveilnav.simulator.truth.error_model import FEATURES, ErrorModel, Floats, Kind, Luck, visible_rad
from surveilnav.simulator.world.labels import TARGETS

_NEAR_CHORD, _NEAR_M = 0.52, 1.0  # 30 degrees
CHORDS = (0.0, 0.1, 0.25, 0.5, 0.8, 1.2, 2.0)


class Band(NamedTuple):
    """What detectors depend on: its name, the edges of its bins, and its value for every row."""

    name: str
    edges: tuple[float, ...]
    of: Callable[[OutcomeTable], Floats]


BANDS = (
    Band("distance [m]", (0.0, 1.0, 1.5, 2.0, 3.0, 4.0, 5.5, 13.0), lambda r: r.range_m),
    Band(
        "visible size [mrad]",
        (20, 50, 100, 150, 220, 320, 500, 2000),
        lambda r: 1000 * visible_rad(r.x),
    ),
    Band("share of outline hidden", (0.0, 0.1, 0.25, 0.4, 0.6, 0.8, 1.01), lambda r: r.x[:, FEATURES.index("hidden")]),
    Band(
        "seen from above by [degrees]",
        (-90, 0, 10, 20, 35, 50, 90),
        lambda r: np.degrees(np.arcsin(np.clip(r.x[:, FEATURES.index("elevation")], -1, 1))),
    ),
)


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """What one detector, real or simulated, made of the same views. ``presence``: (views, 80); ``building``: (views,)."""

    rows: dict[str, OutcomeTable]
    presence: NDArray[np.float32]
    is_camera: NDArray[np.bool_]
    building: NDArray[np.str_]

    @classmethod
    def real(cls, buildings: Sequence[MeasuredViews]) -> Side:
        """What the detector found."""
        looks = [look for building in buildings for look in building.views]
        presence = np.array([look.presence for look in looks], np.float32)
        return cls(rows_of(buildings), presence, np.array([look.is_camera for look in looks]), _names(buildings))

    @classmethod
    def simulated(cls, buildings: Sequence[MeasuredViews], models: Mapping[str, ErrorModel], seed: int) -> Side:
        """By the model of each building."""
        seen = [simulated(building, models[building.name], seed) for building in buildings]
        is_camera = np.array([look.is_camera for building in buildings for look in building.views])
        rows = rows_of(buildings, [found for found, _ in seen])
        return cls(rows, np.concatenate([p for _, p in seen]), is_camera, _names(buildings))

    def named(self, keep: NDArray[np.bool_]) -> float:
        """The share of some things that were found and called by their own name."""
        return float((self.rows["thing"].found & self.rows["thing"].right)[keep].mean())

    def false_rate(self, views: NDArray[np.bool_]) -> float:
        """False targets a view, of some views."""
        return sum(self.false(views).values()) / max(1, int(views.sum()))

    def right_scores(self) -> Floats:
        """Scores of targets that were called by their name."""
        rows = self.rows["thing"]
        return rows.score[rows.found & rows.right & np.isin(rows.labels, TARGETS)]

    def false_scores(self) -> Floats:
        """Scores of false targets."""
        return np.concatenate([r.score[r.found & ~r.right & np.isin(r.name, TARGETS)] for r in self.rows.values()])

    def false(self, views: NDArray[np.bool_]) -> Counter[str]:
        """Wrong names of targets, by name, in some views."""
        names: list[str] = []
        for rows in self.rows.values():
            names += rows.name[rows.found & ~rows.right & views[rows.view]].tolist()
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
        texts = class_space.embed_texts([value_prompt(target) for target in TARGETS])
        return np.asarray(images @ texts.T, np.float64)


def _names(buildings: Sequence[MeasuredViews]) -> NDArray[np.str_]:
    return np.repeat([building.name for building in buildings], [len(building.views) for building in buildings])


def _near(rows: OutcomeTable, most: int) -> NDArray[np.int64]:
    pairs = pairs_of(rows, np.random.default_rng(0), most)
    chord, _ = apart(rows, pairs)
    a, b = pairs.T
    chosen: NDArray[np.int64] = pairs[(chord <= _NEAR_CHORD) & (np.abs(rows.range_m[a] - rows.range_m[b]) <= _NEAR_M)]
    return chosen


def correlations(side: Side, kind: str) -> list[tuple[float, float]]:
    """(correlation of the luck of finding, pairs) by the chord between two views of an instance at like ranges."""
    rows = side.rows[kind]
    pairs = pairs_of(rows, np.random.default_rng(0), 400_000)
    chord, ratio = apart(rows, pairs)
    weights = fit_probit(rows.x, rows.labels, rows.found)
    p = ndtr(Kind(weights, Luck(0.0, 0.0, 1.0, 2.0), {}, 0.0, {}, {}, {}).ease(rows.x, rows.labels))
    left = (rows.found - p) / np.sqrt(p * (1 - p))
    out = []
    for low, high in itertools.pairwise(CHORDS):
        near = (chord >= low) & (chord < high) & (ratio < 0.25)
        a, b = pairs[near].T
        out.append((float((left[a] * left[b]).mean()) if near.any() else float("nan"), float(near.sum())))
    return out


def compare(real: Side, sims: Sequence[Side], model: ErrorModel, about: str) -> str:
    """The page; ``about`` says which model each building is compared with."""
    row = partial(_row, real, sims)

    def named(name: str, keep: NDArray[np.bool_]) -> str:
        return row(name, lambda side: side.named(keep), int(keep.sum()))

    things = real.rows["thing"]
    target, by_camera = np.isin(things.labels, TARGETS), real.is_camera[things.view]
    return "\n".join(
        [
            "# The simulated detector against the real one",
            "",
            f"Source of the model: {model.source}.",
            "",
            f"{about} Compared: {int((~real.is_camera).sum())} robot views and {int(real.is_camera.sum())} camera views. Real: "
            f"`compact` on pixels, in COCO's words. Simulated: mean of {len(sims)} seeds (least–most).",
            "",
            "![found under its name, by distance, size, occlusion and angle of sight](reliability.png)",
            "",
            "![luck, scores, false alarms, value](behaviour.png)",
            "",
            "## Found, and called by its own name",
            "",
            "| class | visible | real | simulated |",
            "|---|---|---|---|",
            *(named(label, things.labels == label) for label in TARGETS),
            named("targets, robot views", target & ~by_camera),
            named("targets, camera views", target & by_camera),
            "",
            "## False targets, persistence, value",
            "",
            "| measure | pairs | real | simulated |",
            "|---|---|---|---|",
            *_measures(real, row),
            "",
            "## What is called what",
            "",
            "Of everything that views truly show, how much [%] is called so: real / simulated.",
            "",
            *_confusion(real, sims),
            "",
            "## By distance, size, occlusion and angle of sight",
            "",
            "Targets that are called by their own name, and all else (things and places) that is called a target, "
            "each as a share of what views show.",
            "",
            *_by_band(real, sims),
            "## By building",
            "",
            "False targets a view, and the share of visible targets that are called by their name.",
            "",
            "| building | views | false, real | simulated | named | real | simulated |",
            "|---|---|---|---|---|---|---|",
            *(_building(name, real, sims) for name in dict.fromkeys(real.building.tolist())),
            "",
        ]
    )


def _row(
    real: Side, sims: Sequence[Side], name: str, of: Callable[[Side], float], n: int | None = None, digits: int = 2
) -> str:
    """A measure of the real side, and its mean (least–most) over the simulated ones. ``n``: of how many it is."""
    values = [of(side) for side in sims]
    low, mean, high = (f"{f(values):.{digits}f}" for f in (min, np.mean, max))
    return f"| {name} | {'' if n is None else n} | {of(real):.{digits}f} | {mean} ({low}–{high}) |"


def _measures(real: Side, row: Callable[..., str]) -> list[str]:
    """The lines on false targets, persistence and value."""
    return [
        row("false targets a robot view", lambda side: side.false_rate(~real.is_camera)),
        row("false targets a camera view", lambda side: side.false_rate(real.is_camera)),
        row("a second view within 1 m and 30° repeats a false target", lambda s: s.repeated()[0], real.repeated()[1]),
        *_persistence(row),
        row("mean score of right names", lambda side: float(side.right_scores().mean())),
        row("mean score of false targets", lambda side: float(side.false_scores().mean())),
        row("value (cosine of view and target): 10 % quantile", lambda s: float(np.quantile(s.values(), 0.1))),
        row("value: median", lambda s: float(np.median(s.values()))),
        row("value: 90 % quantile", lambda s: float(np.quantile(s.values(), 0.9))),
        row("value: correlation with the real one's", lambda s: _correlation(s.values(), real.values())),
    ]


def _confusion(real: Side, sims: Sequence[Side]) -> list[str]:
    """A line for every target, one for each kind of thing that is none."""
    named: tuple[tuple[str, str, Callable[[OutcomeTable], NDArray[np.bool_]]], ...] = (
        *((label, "thing", lambda r, label=label: r.labels == label) for label in TARGETS),
        ("another class", "thing", lambda r: ~np.isin(r.labels, TARGETS)),
        ("furniture without a class", "other", lambda r: np.ones(len(r.ids), bool)),
        ("wall, floor, door", "place", lambda r: np.ones(len(r.ids), bool)),
    )
    lines = ["| shown | visible | " + " | ".join((*TARGETS, "another class", "not found")) + " |", "|" + "---|" * 10]
    for shown, kind, of in named:
        keep = of(real.rows[kind])
        of_real, *of_sims = (_shares_called(side.rows[kind].name[keep]) for side in (real, *sims))
        cells = [f"{100 * r:.1f} / {100 * s:.1f}" for r, s in zip(of_real, np.mean(of_sims, axis=0), strict=True)]
        lines.append(f"| {shown} | {int(keep.sum())} | " + " | ".join(cells) + " |")
    return lines


def _shares_called(names: NDArray[np.str_]) -> list[float]:
    """The share of each target, of another class, and of nothing, in what things are called."""
    said = Counter(names.tolist())
    of_targets = [said[t] for t in TARGETS]
    counts = [*of_targets, len(names) - sum(of_targets) - said[""], said[""]]
    return [n / max(1, len(names)) for n in counts]


def _by_band(real: Side, sims: Sequence[Side]) -> list[str]:
    lines = []
    for band in BANDS:
        lines += [
            f"| {band.name} | targets | named, real | simulated | all else | called a target, real | simulated |",
            "|---|---|---|---|---|---|---|",
        ]
        values = {kind: np.digitize(band.of(rows), band.edges[1:-1]) for kind, rows in real.rows.items()}
        for i, (low, high) in enumerate(itertools.pairwise(band.edges)):
            n_targets, n_else, of_real = _rates(real, values, i)
            of_sims = np.mean([_rates(side, values, i)[2] for side in sims], axis=0)
            cells = [f"{r:.3f} | {s:.3f}" for r, s in zip(of_real, of_sims, strict=True)]
            lines.append(f"| {low:g} to {high:g} | {n_targets} | {cells[0]} | {n_else} | {cells[1]} |")
        lines.append("")
    return lines


def _rates(side: Side, bin_of: Mapping[str, NDArray[np.int64]], i: int) -> tuple[int, int, tuple[float, float]]:
    """Targets and all else in a bin; the share of the first that is called by its name, of the second by a target's."""
    n_targets = n_else = named = false = 0
    for kind, rows in side.rows.items():
        here = bin_of[kind] == i
        target = np.isin(rows.labels, TARGETS) if kind == "thing" else np.zeros(len(rows.ids), bool)
        n_targets += int((here & target).sum())
        n_else += int((here & ~target).sum())
        named += int((here & target & rows.right).sum())
        false += int((here & ~target & np.isin(rows.name, TARGETS)).sum())
    return n_targets, n_else, (named / max(1, n_targets), false / max(1, n_else))


def _building(name: str, real: Side, sims: Sequence[Side]) -> str:
    views = real.building == name
    things = real.rows["thing"]
    targets = np.isin(things.labels, TARGETS) & views[things.view]

    def cells(of: Callable[[Side], float]) -> str:
        return f"{of(real):.2f} | {np.mean([of(side) for side in sims]):.2f}"

    false, named = cells(lambda side: side.false_rate(views)), cells(lambda side: side.named(targets))
    return f"| {name} | {int(views.sum())} | {false} | {int(targets.sum())} | {named} |"


def _persistence(row: Callable[[str, Callable[[Side], float]], str]) -> list[str]:
    lines = []
    for kind, name in (("thing", "things with a name"), ("other", "things without"), ("place", "walls and floors")):
        again: Callable[[Side], float] = lambda side, kind=kind: side.agreement(kind)[0]  # type: ignore[misc]  # noqa: E731
        chance: Callable[[Side], float] = lambda side, kind=kind: side.agreement(kind)[1]  # type: ignore[misc]  # noqa: E731
        lines += [row(f"{name}: found again in a near view", again), row("… if views were independent", chance)]
    return lines


def _correlation(a: Floats, b: Floats) -> float:
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])
