"""How well the joint map's chances of objects hold, without searches.

    python -m surveilnav.benchmark.studies.calibration.objects [--backend compact] [--views 100]

The views of ``surveilnav.benchmark.studies.calibration.chances``, with what a backend found in their pixels, go through fusion's
object
map as in a search: all cameras first, then the robot's tour. Every so many views the map's objects are looked at: what they are
believed to be, and what they truly are. Chances of detections come from a table of other buildings. The settings of
``PosteriorConfig`` are also fitted anew, each building left out in turn.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from surveilnav.benchmark.studies.calibration.chances import DEFAULT, fit, judged, looks_for, true_owners
from surveilnav.benchmark.studies.calibration.run import OUT
from surveilnav.benchmark.studies.calibration.views import Found, Look, Looks
from surveilnav.errors import SurveilNavError
from surveilnav.perception.chances import ChanceTable, Floats, with_chances
from surveilnav.perception.protocols import RgbdView
from surveilnav.perception.segmenters.depth_in_box import DepthInBox
from surveilnav.robot_body import CAMERA_HEIGHT_M, DEPTH_RANGE_M
from surveilnav.sensing.views import Detected, PosedView, ViewPerception
from surveilnav.services.fusion.core import ObjectConfig
from surveilnav.services.fusion.core.config import PosteriorConfig
from surveilnav.services.fusion.core.objects.evidence import Evidence
from surveilnav.services.fusion.core.objects.object_map import ObjectMap
from surveilnav.services.fusion.core.objects.posterior_confirmation import PosteriorConfirmation
from surveilnav.simulator.furniture.labels import TARGETS
from surveilnav.simulator.simulation import CAMERA_DEPTH_RANGE_M

EVERY = 25  # views of the robot from one look at the map to the next
_STOREY_M = 1.0  # floors are at least so far apart
_RANGES_M = {"robot": DEPTH_RANGE_M, "camera": CAMERA_DEPTH_RANGE_M}
_NO_PICTURE = np.zeros((0, 0, 3), np.uint8)
_BINS = (0.0, 0.1, 0.25, 0.4, 0.6, 0.8, 0.9, 1.0)
_CLOSE = 1e-3


@dataclass(frozen=True, slots=True)
class Claim:
    """An object of the map called by some target's name, at one time.

    Attributes:
        building: its number. label: what it is called. truth: what it is, "" if it is nothing.
        evidence: fusion's, as plain values. misfit: whether it has no size that the class can have.
        weight: one over how often the object was looked at: it counts once.
    """

    building: int
    label: str
    truth: str
    evidence: dict[str, Any]
    misfit: bool
    weight: float = 1.0

    @property
    def right(self) -> bool:
        return self.label == self.truth


# --- what the map believes ------------------------------------------------------------------------------------------


def claims_of(number: int, building: Looks, table: ChanceTable, config: ObjectConfig) -> list[Claim]:
    """All claims about the objects of one building, at all times that they were looked at."""
    floors_m, owners, names = _floors_m(building), _Owners(), _names(building)
    maps = {z_m: ObjectMap(f"{z_m:g}", z_m, 0.025, config) for z_m in floors_m}
    cameras = [look for look in building.looks if look.is_camera]
    tour = [look for look in building.looks if not look.is_camera]
    seen: list[tuple[tuple[float, int], Claim]] = []
    for i, look in enumerate([*cameras, *tour]):
        z_m = max((z for z in floors_m if z < look.T_world_camera.matrix()[2, 3] - 0.3), default=floors_m[0])
        view = _view(look, z_m, building)
        found = with_chances(_seen(look, view, names), view.depth_m, view.camera, table, is_camera=look.is_camera)
        maps[z_m].add_detections(view, found.detections)
        owners.note(z_m, maps[z_m], found.detections, true_owners(building, look))
        n_tour = i + 1 - len(cameras)
        if n_tour >= 0 and (n_tour % EVERY == 0 or n_tour == len(tour)):
            for z, of_floor in maps.items():
                seen += _claims(number, z, of_floor, owners)
    often = Counter(key for key, _ in seen)
    return [Claim(c.building, c.label, c.truth, c.evidence, c.misfit, 1.0 / often[key]) for key, c in seen]


def _claims(number: int, z_m: float, of_floor: ObjectMap, owners: _Owners) -> list[tuple[tuple[float, int], Claim]]:
    rows = []
    for state in of_floor.state()["objects"]:
        key, evidence = (z_m, state["id"]), state["evidence"]
        for label in sorted({*evidence["robot"], *evidence["surveillance"]} & set(TARGETS)):
            misfit = bool(of_floor.size_mismatch(state["id"], label))
            rows.append((key, Claim(number, label, owners.truth(key), evidence, misfit)))
    return rows


class _Owners:
    """Which things the detections of each object truly show."""

    def __init__(self) -> None:
        self._of: defaultdict[tuple[float, int], Counter[tuple[Any, ...]]] = defaultdict(Counter)

    def note(
        self, z_m: float, of_floor: ObjectMap, found: Sequence[Detected], owners: Sequence[tuple[Any, ...]]
    ) -> None:
        """Follows what a view's detections were joined to, and which objects became one."""
        owner = {(d.label, d.box_px): o for d, o in zip(found, owners, strict=True)}
        for change in of_floor.pop_changes(0):
            key, event = (z_m, change.object_id), change.event
            if event.what == "merged":
                self._of[key].update(self._of.pop((z_m, change.absorbed), Counter()))
            elif event.box_px is not None:
                self._of[key][owner[event.label, event.box_px]] += 1

    def truth(self, key: tuple[float, int]) -> str:
        """The name of the thing that half of an object's detections or more show, "" for none."""
        shown = self._of[key]
        (most, n) = shown.most_common(1)[0]
        return str(most[-1]) if 2 * n >= shown.total() else ""


def _floors_m(building: Looks) -> list[float]:
    """Altitudes of the floors that the robot was on."""
    floors: list[float] = []
    for z_m in sorted(
        look.T_world_camera.matrix()[2, 3] - CAMERA_HEIGHT_M for look in building.looks if not look.is_camera
    ):
        if not floors or z_m > floors[-1] + _STOREY_M:
            floors.append(float(z_m))
    return floors


def _view(look: Look, z_m: float, building: Looks) -> PosedView:
    _, depth_m = look.truth(building.labels)
    T = look.T_world_camera.matrix()
    range_m = _RANGES_M["camera" if look.is_camera else "robot"]
    return PosedView(
        look.source,
        look.view,
        look.seq,
        look.seq,
        f"{z_m:g}",
        T,
        look.camera,
        float(T[2, 3]) - z_m,
        _NO_PICTURE,
        depth_m,
        range_m,
    )


def _names(building: Looks) -> list[str]:
    """All that anything was called."""
    found = [d for look in building.looks for d in look.found]
    return sorted({d.label for d in found} | {d.second for d in found if d.second})


def _seen(look: Look, view: PosedView, names: Sequence[str]) -> ViewPerception:
    """What was found, with masks of depth, and embeddings that say how much alike two detections were called."""
    boxes = np.array([d.box_px for d in look.found], np.float32).reshape(-1, 4)
    masks = DepthInBox().segment([RgbdView(view.rgb, view.depth_m, view.camera)], [boxes])[0]
    found = tuple(
        Detected(d.label, d.score, d.box_px, mask, _embedding(d, names))
        for d, mask in zip(look.found, masks, strict=True)
    )
    return ViewPerception("kept", found, np.ones(1, np.float32), "names")


def _embedding(d: Found, names: Sequence[str]) -> NDArray[np.float32]:
    shares = np.zeros(len(names), np.float32)
    shares[names.index(d.label)] = d.certainty
    if d.second:
        shares[names.index(d.second)] = 1.0 - d.certainty
    unit: NDArray[np.float32] = np.sqrt(shares / shares.sum())
    return unit


# --- how well it holds ----------------------------------------------------------------------------------------------


def chances_of(claims: Sequence[Claim], config: PosteriorConfig, misfit_factor: float) -> Floats:
    """(N,) how likely each claim is, by fusion's rule."""
    rule, known = PosteriorConfirmation(config), {}
    for claim in claims:
        if id(claim.evidence) not in known:
            known[id(claim.evidence)] = rule.confidences(Evidence.from_state(claim.evidence))
    found = [known[id(c.evidence)].of_class(c.label) * (misfit_factor if c.misfit else 1.0) for c in claims]
    return np.array(found)


def scores_of(claims: Sequence[Claim]) -> Floats:
    """(N,) the paper's confidence: the mean score of robots or of cameras, whichever is higher."""
    means = [
        max(
            score / n
            for kind in ("robot", "surveillance")
            if c.label in c.evidence[kind]
            for n, score in [c.evidence[kind][c.label]]
        )
        for c in claims
    ]
    return np.array(means)


@dataclass(frozen=True, slots=True)
class Figures:
    """Of chances against what was right; ``auc``: how likely a right claim has the higher chance of two (Hanley 1982)."""

    log_loss: float
    auc: float
    error: float


def figures(chance: Floats, claims: Sequence[Claim]) -> Figures:
    right, weight = _right(claims), _weight(claims)
    p = np.clip(chance, _CLOSE, 1.0 - _CLOSE)
    loss = np.average(-np.log(np.where(right, p, 1.0 - p)), weights=weight)
    at = np.digitize(chance, _BINS[1:-1])
    off = weight * (chance - right)
    error = sum(abs(off[at == b].sum()) for b in range(len(_BINS) - 1)) / weight.sum()
    return Figures(float(loss), _auc(chance, right, weight), float(error))


def _auc(chance: Floats, right: NDArray[np.bool_], weight: Floats) -> float:
    higher = np.sign(chance[right][:, None] - chance[~right]) / 2.0 + 0.5
    pairs = weight[right][:, None] * weight[~right]
    return float((higher * pairs).sum() / pairs.sum()) if pairs.size else float("nan")


def precision_recall(chance: Floats, claims: Sequence[Claim], threshold: float) -> tuple[float, float]:
    """Of what reaches the threshold, the share that is right; of what is right, the share that reaches it."""
    right, weight, over = _right(claims), _weight(claims), chance >= threshold
    found = float(weight[over & right].sum())
    return found / max(1e-9, float(weight[over].sum())), found / max(1e-9, float(weight[right].sum()))


def _right(claims: Sequence[Claim]) -> NDArray[np.bool_]:
    return np.array([c.right for c in claims])


def _weight(claims: Sequence[Claim]) -> Floats:
    return np.array([c.weight for c in claims])


# --- fitting --------------------------------------------------------------------------------------------------------

_START = np.log([0.5, 1.0, 0.67])  # repeat_odds - 1, 1 / miss_odds - 1, correlation / (1 - correlation)


def fitted(claims: Sequence[Claim], misfit_factor: float) -> PosteriorConfig:
    """The settings of least log loss, near even ones where there are few data."""

    def loss(z: Floats) -> float:
        return figures(chances_of(claims, _settings(z), misfit_factor), claims).log_loss + 1e-3 * float(
            ((z - _START) ** 2).sum()
        )

    options = {"maxiter": 3, "xtol": 0.05, "ftol": 1e-3}
    return _settings(minimize(loss, _START, method="Powell", bounds=[(-3.0, 3.0)] * 3, options=options).x)


def _settings(z: Floats) -> PosteriorConfig:
    repeat, miss, alike = np.exp(z).tolist()
    return PosteriorConfig(repeat_odds=1.0 + repeat, miss_odds=1.0 / (1.0 + miss), correlation=alike / (1.0 + alike))


def left_out(claims: Sequence[Claim], misfit_factor: float) -> Floats:
    """(N,) chances by settings that were fitted to other buildings."""
    number, chance = np.array([c.building for c in claims]), np.zeros(len(claims))
    for k in sorted(set(number.tolist())):
        config = fitted([c for c in claims if c.building != k], misfit_factor)
        chance[number == k] = chances_of([c for c in claims if c.building == k], config, misfit_factor)
    return chance


# --- the page -------------------------------------------------------------------------------------------------------


def page(
    claims: Sequence[Claim],
    config: ObjectConfig,
    refitted: PosteriorConfig,
    others: Floats,
    source: str,
    backend: str = DEFAULT,
) -> str:
    """What it says, in Markdown."""
    rule, factor = config.confirmation.posterior, config.false_positives.size_mismatch_factor
    chance, score = chances_of(claims, rule, factor), scores_of(claims)
    ours = figures(chance, claims)
    lines = [
        "# How likely an object is what the map calls it",
        "",
        f"Of what the map calls a target with chance p, about p is one: the expected calibration error is {ours.error:.3f}. "
        f"Of two objects, the right one has the higher chance {ours.auc:.0%} of the time. One rule and one threshold hold for "
        "all words.",
        "",
        f"Source: {source}. Made by `python -m surveilnav.benchmark.studies.calibration.objects"
        f"{'' if backend == DEFAULT else f' --backend {backend}'}`. An object counts once, however often "
        "the map was looked at. Chances of detections come from tables that never saw the building.",
        "",
        "| | log loss | AUC | calibration error |",
        "|---|---|---|---|",
        _row("mean score, as the paper's rule has it", figures(score, claims)),
        _row(
            f"ours: repeat odds {rule.repeat_odds:g}, miss odds {rule.miss_odds:g}, correlation {rule.correlation:g}",
            ours,
        ),
        _row("ours, settings fitted to the other buildings", figures(others, claims)),
        "",
        f"Settings fitted to all buildings: repeat odds {refitted.repeat_odds:.2f}, "
        f"miss odds {refitted.miss_odds:.2f}, correlation {refitted.correlation:.2f}.",
        "",
        f"| | objects called so | right | AUC | mean chance | precision, recall at {rule.min_chance:g} |",
        "|---|---|---|---|---|---|",
    ]
    for label in ("all", *TARGETS):
        of = [i for i, c in enumerate(claims) if label in ("all", c.label)]
        if of:
            lines.append(_class_row(label, chance[of], [claims[i] for i in of], rule.min_chance))
    lines += ["", "| chance | objects called so | mean chance | right |", "|---|---|---|---|"]
    right, weight = _right(claims), _weight(claims)
    for low, high in pairwise(_BINS):
        in_bin = (chance >= low) & (chance < high)
        if in_bin.any():
            w = weight[in_bin]
            mean, share = np.average(chance[in_bin], weights=w), np.average(right[in_bin], weights=w)
            lines.append(f"| {low:g} to {high:g} | {w.sum():.0f} | {mean:.2f} | {share:.2f} |")
    return "\n".join([*lines, ""])


def _row(name: str, f: Figures) -> str:
    return f"| {name} | {f.log_loss:.3f} | {f.auc:.3f} | {f.error:.3f} |"


def _class_row(label: str, chance: Floats, claims: Sequence[Claim], threshold: float) -> str:
    weight, right = _weight(claims), _right(claims)
    precision, recall = precision_recall(chance, claims, threshold)
    return (
        f"| {label} | {weight.sum():.0f} | {np.average(right, weights=weight):.2f} | {_auc(chance, right, weight):.2f} | "
        f"{np.average(chance, weights=weight):.2f} | {precision:.2f}, {recall:.2f} |"
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Measures what isn't measured yet, and writes the page."""
    parser = argparse.ArgumentParser(
        prog="surveilnav.benchmark.studies.calibration.objects", description=__doc__.partition("\n")[0]
    )
    parser.add_argument("--backend", default=DEFAULT, help="what looks at the pictures; it has a vocabulary")
    parser.add_argument("--views", type=int, default=100, help="of the robot, about, in every building")
    parser.add_argument("--out", type=Path, help=f"{OUT}/objects.md, of other backends objects_<backend>.md")
    args = parser.parse_args(argv)
    try:
        buildings, model = looks_for(args.backend, args.views)
    except SurveilNavError as error:
        print(f"objects: {error}", file=sys.stderr)
        return 2
    rows, config = judged(buildings), ObjectConfig()
    claims = [
        claim
        for k, building in enumerate(buildings)
        for claim in claims_of(k, building, fit(rows.where(rows.building != k)), config)
    ]
    factor = config.false_positives.size_mismatch_factor
    n_views = sum(len(b.looks) for b in buildings)
    source = f"what {model} found in {n_views} views of {', '.join(b.name for b in buildings)}"
    out = args.out or OUT / ("objects.md" if args.backend == DEFAULT else f"objects_{args.backend}.md")
    text = page(claims, config, fitted(claims, factor), left_out(claims, factor), source, args.backend)
    out.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
