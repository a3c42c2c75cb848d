"""From what was found to the error model of the backend ``simulated``: probit regressions, shrunk where data are few."""

from __future__ import annotations

from collections import Counter

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import log_ndtr, ndtr, ndtri

from surveilnav.benchmark.studies.calibration.haze import fit_haze, rounded
from surveilnav.benchmark.studies.calibration.views import MIN_SIZE_RAD, OutcomeTable
from surveilnav.perception.vocabulary import COCO
from surveilnav.simulator.truth.error_model import FEATURES, SIGHTS, ErrorModel, Floats, Kind, Luck

MIN_SCORE = 0.25
#: Standard deviations of the priors of all weights, and of a class's own part of them.
_POOLED_SD = 2.0
_CLASS_SD = {"one": 0.8, "size": 0.4, "size_squared": 0.2, "range": 0.4, "camera": 0.4}
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_QUANTILES = np.array([0.0, 0.02, 0.1, 0.25, 0.5, 0.75, 0.9, 0.98, 1.0])
_BOXES = 48
_FEW_BOXES = 12
_PAIRS = 40_000
_DRAWS = 16
_FEW_PAIRS = 20
_FEW_WEAK = 20
_NO_SCORE = (-1e-3, 0.0)  # (ease, score) of what is missed, where too few weak scores tell more
_NAMES = 5.0  # as many of every name count as if they had come out as measured
_RAREST = 1e-4  # share of a name that is known at all
_Shares = dict[str, float]
_CLASS_PRIOR, _SIGHT_PRIOR = 3.0, 10.0  # as many wrong names are thought to have been those of more things
_GAIN = 0.6  # of a name's being kept, by what near views agree too little


def fit_probit(x: Floats, labels: NDArray[np.str_], y: NDArray[np.bool_]) -> dict[str, list[float]]:
    """Weights of P(y) = Phi(x w) by class, "" for all classes that have none: pooled weights plus a class's own part.

    The maximum a posteriori under normal priors, so that a class with few data stays near all others.
    """
    classes = sorted(set(labels) - {""})
    columns = [FEATURES.index(name) for name in _CLASS_SD]
    owner = np.array([classes.index(label) if label else -1 for label in labels])
    n = x.shape[1]
    sd = np.concatenate([np.full(n, _POOLED_SD), np.tile(list(_CLASS_SD.values()), len(classes))])
    parts = x[:, columns]

    def loss(w: Floats) -> tuple[float, Floats]:
        own = np.vstack([w[n:].reshape(len(classes), len(columns)), np.zeros(len(columns))])
        eta = x @ w[:n] + (parts * own[owner]).sum(axis=1)
        sign = np.where(y, 1.0, -1.0)
        log_p = log_ndtr(sign * eta)
        slope = -sign * np.exp(-0.5 * eta**2 - log_p) / np.sqrt(2 * np.pi)
        grad = np.zeros((len(classes) + 1, len(columns)))
        np.add.at(grad, owner, slope[:, None] * parts)
        gradient = np.concatenate([slope @ x, grad[: len(classes)].ravel()])
        return float(-log_p.sum() + 0.5 * ((w / sd) ** 2).sum()), gradient + w / sd**2

    w = minimize(loss, np.zeros(len(sd)), jac=True, method="L-BFGS-B", options={"maxiter": 500}).x
    rows = {"": w[:n]}
    for i, label in enumerate(classes):
        row = w[:n].copy()
        row[columns] += w[n:].reshape(len(classes), len(columns))[i]
        rows[label] = row
    return {label: [round(float(v), 3) for v in row] for label, row in rows.items()}


def both_above(a: Floats, b: Floats, r: Floats) -> Floats:
    """P(A < a, B < b) of standard normals with correlation r (Drezner and Wesolowsky 1990, by Gauss-Legendre)."""
    t = 0.5 * r[:, None] * (_NODES + 1)
    s = 1 - t**2
    density = np.exp(-(a[:, None] ** 2 - 2 * t * a[:, None] * b[:, None] + b[:, None] ** 2) / (2 * s)) / np.sqrt(s)
    return np.asarray(ndtr(a) * ndtr(b) + 0.5 * r * (density * _WEIGHTS).sum(axis=1) / (2 * np.pi))


def pairs_of(rows: OutcomeTable, rng: np.random.Generator, most: int = _PAIRS) -> NDArray[np.int64]:
    """(N, 2) rows that show the same instance in two views: half of an instance's pairs are of the nearest views."""
    groups: dict[tuple[int, int], list[int]] = {}
    for i, key in enumerate(zip(rows.building.tolist(), rows.ids.tolist(), strict=True)):
        groups.setdefault(key, []).append(i)
    members = [np.array(g) for g in groups.values() if len(g) > 1]
    if not members:
        return np.zeros((0, 2), np.int64)
    pairs = []
    each = max(8, most // len(members))
    for g in members:
        a, b = np.triu_indices(len(g), 1)
        chosen = rng.permutation(len(a))
        both = np.stack([g[a[chosen]], g[b[chosen]]], axis=1)
        chord, ratio = apart(rows, both)
        near = np.argsort(chord / 0.5 + ratio / 0.5, kind="stable")
        pairs.append(both[np.union1d(near[:each], np.arange(min(each, len(both))))])
    joined = np.concatenate(pairs)
    return joined[rng.permutation(len(joined))[:most]]


def apart(rows: OutcomeTable, pairs: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Of pairs: chord between the directions of sight, and difference of the logarithms of range."""
    a, b = pairs.T
    return (
        np.linalg.norm(rows.direction[a] - rows.direction[b], axis=1),
        np.abs(np.log(rows.range_m[a] / rows.range_m[b])),
    )


def fit_luck(rows: OutcomeTable, eta: Floats, y: NDArray[np.bool_], rng: np.random.Generator) -> Luck:
    """How alike luck is, by the likelihood of pairs of views of the same instance (Kuk and Nott 2000)."""
    pairs = pairs_of(rows, rng)
    if len(pairs) < 50:
        return Luck(0.3, 0.3, 0.6, 2.0)
    chord, ratio = apart(rows, pairs)
    a, b = eta[pairs[:, 0]], eta[pairs[:, 1]]
    sign_a, sign_b = (np.where(y[pairs[:, i]], 1.0, -1.0) for i in (0, 1))

    def loss(w: Floats) -> float:
        luck = _luck_of(w)
        r = luck.instance + luck.field * np.exp(
            -0.5 * ((chord / luck.angle_rad) ** 2 + (ratio / np.log(luck.range_ratio)) ** 2)
        )
        p = both_above(sign_a * a, sign_b * b, sign_a * sign_b * r)
        prior = ((np.log(luck.angle_rad) - np.log(0.5)) / 0.5) ** 2 + (
            (np.log(np.log(luck.range_ratio)) + 0.7) / 0.5
        ) ** 2
        return float(-np.log(np.maximum(p, 1e-9)).sum() + prior)

    best = minimize(
        loss, np.array([-0.7, 0.0, np.log(0.5), np.log(0.5)]), method="Nelder-Mead", options={"maxfev": 160}
    )
    return _luck_of(best.x)


def _luck_of(w: Floats) -> Luck:
    shares = np.exp(np.clip([w[0], w[1], 0.0], -6, 6))
    shares = shares / shares.sum() * 0.98
    angle, ratio = np.exp(np.clip(w[2:], -2.5, 1.0))
    return Luck(*(round(float(v), 3) for v in (shares[0], shares[1], angle, np.exp(ratio))))


def fit_kind(rows: OutcomeTable, presence: NDArray[np.float32], seed: int = 0) -> Kind:
    """One kind's model. ``presence``: (views, 80) what too weak scores make of each class in a view; NaN: not weak."""
    rng = np.random.default_rng(seed)
    weights = fit_probit(rows.x, rows.labels, rows.found)
    kind = Kind(weights, Luck(0, 0, 1, 2), {}, 0.0, {}, {}, {})
    eta = kind.ease(rows.x, rows.labels)
    luck = fit_luck(rows, eta, rows.found, rng)
    found = rows.where(rows.found)
    own: dict[str, list[float]] = {}
    own_luck = Luck(0.0, 0.0, 1.0, 2.0)
    p_own = np.zeros(len(eta))
    if found.right.any():
        own = fit_probit(found.x, found.labels, found.right)
        kind = Kind(weights, luck, kind.names, 0.0, {}, {}, {}, own)
        own_luck = fit_luck(found, kind.own_ease(found.x, found.labels), found.right, rng)
        p_own = ndtr(kind.own_ease(rows.x, rows.labels))
    wrong = found.where(~found.right)
    names = _names(wrong)
    ease = np.tile(eta, _DRAWS) + rng.standard_normal(len(eta) * _DRAWS)
    is_own = np.tile(p_own, _DRAWS) > rng.random(len(ease))
    certain = {"right": found.right, "wrong": ~found.right}
    return Kind(
        weights,
        luck,
        names,
        _name_kept(wrong, names, rng),
        {
            of: _score_knots(ease[is_own == (of == "right")], found.score[m], _missed(rows, presence, of == "right"))
            for of, m in certain.items()
        },
        {of: rounded(np.quantile(found.certainty[m], _QUANTILES)) if m.any() else [1.0] for of, m in certain.items()},
        {of: _boxes(found.box[m]) for of, m in certain.items()} | _boxes_by_name(wrong),
        own,
        own_luck,
    )


def _names(wrong: OutcomeTable) -> dict[str, dict[str, _Shares]]:
    """By sight and class, shares of what it is mistaken for; where sightings are few, those of more things count."""
    everything = _shares(wrong, {"chair": 1.0}, 1.0)
    of_class = {label: _shares(wrong.where(wrong.labels == label), everything, _CLASS_PRIOR) for label in wrong.classes}
    names = {}
    for at in SIGHTS:
        seen, of_sight = _seen_at(wrong, at), _shares_at(wrong, at, everything)
        names[at] = {"": _rare_dropped(of_sight, "")}
        for label in wrong.classes:
            both = {s: (of_sight.get(s, 0.0) + of_class[label].get(s, 0.0)) / 2 for s in everything}
            names[at][label] = _rare_dropped(_shares(seen.where(seen.labels == label), both, _CLASS_PRIOR), label)
    return names


def _seen_at(wrong: OutcomeTable, sight: str) -> OutcomeTable:
    """The rows of one of ``SIGHTS``; of places, whose size is their distance, those of all its kind of view: the piece of
    wall that a detection's middle lies on isn't what it takes for a bed."""
    return _seen_alike(wrong, sight) if wrong.kind == "place" else wrong.where(wrong.sight == sight)


def _seen_alike(wrong: OutcomeTable, sight: str) -> OutcomeTable:
    """The rows of all its kind of view."""
    return wrong.where(np.char.startswith(wrong.sight, sight.partition(" ")[0]))


def _shares_at(wrong: OutcomeTable, sight: str, prior: _Shares) -> _Shares:
    """Shares of names at one of ``SIGHTS``; where sightings are few, those of its kind of view count."""
    of_view = _shares(_seen_alike(wrong, sight), prior, _SIGHT_PRIOR)
    return _shares(_seen_at(wrong, sight), of_view, _SIGHT_PRIOR)


def _shares(wrong: OutcomeTable, prior: _Shares, weight: float) -> _Shares:
    counts = Counter(wrong.name.tolist())
    n = sum(counts.values()) + weight
    return {s: (counts[s] + weight * prior.get(s, 0.0)) / n for s in {**prior, **counts}}


def _rare_dropped(shares: _Shares, label: str) -> _Shares:
    """The commonest first; nothing is mistaken for what it is, but always for something."""
    ordered = sorted(shares.items(), key=lambda pair: (-pair[1], pair[0]))
    kept = {s: round(p, 4) for s, p in ordered if p >= 0.005 and s != label}
    return kept if len(kept) > 1 else kept | {s: 0.01 for s in ("chair", "couch", "bed") if s not in (label, *kept)}


def _name_kept(wrong: OutcomeTable, names: dict[str, dict[str, _Shares]], rng: np.random.Generator) -> float:
    """How often an instance's own draw of a name is taken: near views agree by kept^2 + (1 - kept^2) sum of shares^2."""
    pairs = _near_pairs(wrong, rng)
    if len(pairs) < _FEW_PAIRS:
        return 0.8
    first = wrong.where(pairs[:, 0])
    chance = {at: {label: sum(p * p for p in s.values()) for label, s in of.items()} for at, of in names.items()}
    by_chance = float(np.mean([chance[at][label] for at, label in zip(first.sight, first.labels, strict=True)]))
    agreed = (_agreed(wrong, pairs) - by_chance) / max(1e-9, 1 - by_chance)
    return round(float(np.sqrt(np.clip(agreed, 0.0, 1.0))), 3)


def _near_pairs(rows: OutcomeTable, rng: np.random.Generator) -> NDArray[np.int64]:
    pairs = pairs_of(rows, rng)
    chord, ratio = apart(rows, pairs)
    near: NDArray[np.int64] = pairs[(chord < 0.5) & (ratio < 0.35)]
    return near


def _agreed(rows: OutcomeTable, pairs: NDArray[np.int64]) -> float:
    return float((rows.name[pairs[:, 0]] == rows.name[pairs[:, 1]]).mean())


def _missed(rows: OutcomeTable, presence: NDArray[np.float32], right: bool) -> Floats:
    """What is left in the view's scores of things that were missed, where nothing else bears or shows their class."""
    if not right or not set(rows.labels) <= set(COCO):
        return np.zeros(0)
    of_view = Counter(zip(rows.view.tolist(), rows.labels.tolist(), strict=True))
    alone = [of_view[v, label] == 1 for v, label in zip(rows.view.tolist(), rows.labels.tolist(), strict=True)]
    left = rows.where(~rows.found & np.array(alone))
    weak = presence[left.view, [COCO.index(label) for label in left.labels]].astype(np.float64)
    return np.asarray(weak[np.isfinite(weak)])


def _score_knots(ease: Floats, scores: Floats, weak: Floats) -> list[tuple[float, float]]:
    """(ease, score) so that the quantiles of what is found fall on each other; below 0, of what is missed."""
    if not len(scores):
        return [_NO_SCORE, (0.0, MIN_SCORE), (3.0, 0.6)]
    knots = []
    if len(weak) > _FEW_WEAK:
        below = np.quantile(ease[ease < 0], _QUANTILES[2:-1])
        knots = list(zip(below.tolist(), np.quantile(weak, _QUANTILES[2:-1]).tolist(), strict=True))
    else:
        knots.append(_NO_SCORE)
    above = np.quantile(ease[ease > 0], _QUANTILES)
    knots += [(float(e), float(s)) for e, s in zip(above, np.quantile(scores, _QUANTILES), strict=True)]
    return [(round(e, 3), round(s, 3)) for e, s in knots]


def _boxes(boxes: Floats) -> list[list[float]]:
    """Some of the measured boxes, smallest first."""
    if not len(boxes):
        return [[0.0, 0.0, 1.0, 1.0]]
    size = np.where(
        boxes[:, 2:].any(axis=1), (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1]), boxes[:, 0] * boxes[:, 1]
    )
    order = np.argsort(size, kind="stable")
    chosen = order[np.linspace(0, len(order) - 1, min(_BOXES, len(order))).round().astype(int)]
    return [rounded(boxes[i]) for i in chosen]


def _boxes_by_name(wrong: OutcomeTable) -> dict[str, list[list[float]]]:
    counts = Counter(wrong.name.tolist())
    return {name: _boxes(wrong.box[wrong.name == name]) for name in sorted(counts) if counts[name] >= _FEW_BOXES}


def fit(rows: dict[str, OutcomeTable], presence: NDArray[np.float32], source: str) -> ErrorModel:
    """The whole model. ``rows`` by kind; ``source`` says where they come from."""
    what = "Error model of the backend 'simulated' (surveilnav.simulator.truth.error_model): how a real detector errs."
    said = {
        pair for r in rows.values() for pair in zip(r.view[r.found].tolist(), r.name[r.found].tolist(), strict=True)
    }
    unsaid = presence.copy()
    for view, name in said:
        unsaid[view, COCO.index(name)] = np.nan
    kinds = {kind: fit_kind(r, unsaid) for kind, r in rows.items()}
    return ErrorModel(what, source, MIN_SCORE, MIN_SIZE_RAD, kinds, fit_haze(rows, unsaid))


def matched(model: ErrorModel, measured: dict[str, OutcomeTable], drawn: dict[str, OutcomeTable]) -> ErrorModel:
    """The model moved so that finds, own names and wrong names come out as often, and wrong names as alike in near
    views, as measured.

    ``simulated`` calls nothing what it is too large or too small for: what has no name, and a name whose things are
    rarely of the size of what is mistaken for it, would come out too seldom, and one instance would be called too many
    names. ``drawn``: what the model made of the same views.
    """
    kinds = {}
    for of, kind in model.kinds.items():
        wrong = [r[of].where(r[of].found & ~r[of].right) for r in (measured, drawn)]
        names = {at: _moved(of_class, at, *wrong) for at, of_class in kind.names.items()}
        kept, pairs = kind.name_kept, [_near_pairs(r, np.random.default_rng(0)) for r in wrong]
        if min(len(p) for p in pairs) >= _FEW_PAIRS:
            too_few = _agreed(wrong[0], pairs[0]) - _agreed(wrong[1], pairs[1])
            kept = round(float(np.clip(kept + _GAIN * too_few, 0.0, 1.0)), 3)
        both = [(r[of], r[of].found) for r in (measured, drawn)]
        weights, own = _as_often(kind.weights, *both), kind.own
        if own:
            found = [rows.where(is_found) for rows, is_found in both]
            own = _as_often(own, *((rows, rows.right) for rows in found))
        kinds[of] = replace(kind, weights=weights, own=own, names=names, name_kept=kept)
    return replace(model, kinds=kinds)


_Outcomes = tuple[OutcomeTable, NDArray[np.bool_]]


def _as_often(weights: dict[str, list[float]], measured: _Outcomes, drawn: _Outcomes) -> dict[str, list[float]]:
    """Weights of an outcome that shall come out as often as measured in robots' and in cameras' views."""

    def of_views(camera: bool) -> float:
        is_, was = (y[(r.x[:, FEATURES.index("camera")] > 0) == camera] for r, y in (measured, drawn))
        return float(ndtri((is_.sum() + 1) / (len(is_) + 2)) - ndtri((was.sum() + 1) / (len(was) + 2)))

    robot_ = of_views(camera=False)
    more = {"one": robot_, "camera": of_views(camera=True) - robot_}
    return {
        label: [round(w + more.get(name, 0.0), 3) for name, w in zip(FEATURES, row, strict=True)]
        for label, row in weights.items()
    }


def _moved(names: dict[str, _Shares], sight: str, measured: OutcomeTable, drawn: OutcomeTable) -> dict[str, _Shares]:
    """Shares of names at one of ``SIGHTS`` by as much more or less as they came out too seldom or too often."""
    if not (len(measured.name) and len(drawn.name)):
        return names
    should, was = (_shares_at(r, sight, _shares(r, {}, 0.0)) for r in (measured, drawn))
    few = _NAMES / max(1, len(_seen_at(drawn, sight).name))
    factor = {name: (should.get(name, 0.0) + few) / (was.get(name, 0.0) + few) for name in should | was}
    out = {}
    for label, shares in names.items():
        moved = {name: share * factor.get(name, 1.0) for name, share in shares.items()}
        total = sum(moved.values())
        out[label] = {name: max(_RAREST, round(share / total, 4)) for name, share in moved.items()}
    return out
