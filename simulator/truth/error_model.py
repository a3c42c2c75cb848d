"""How a detector errs: what it finds, what it calls it, how sure it is, and how alike its luck is from view to view.

Every thing (or place of a wall or floor) that a view shows has a latent ease: a linear function of what can be seen of
it plus a standard normal luck (a probit model). Above 0 the detector finds it; the score grows with the ease. Luck has
three parts: one of the instance, which every view of it shares; one that changes smoothly with direction and distance
(a Gaussian field of random Fourier features, Rahimi and Recht 2007); one of the single view. All of it is drawn by
hashing, so it depends on seed, view and instance alone, on any machine and in any order.

The figures stand in data/simulated_errors.json; ``python -m surveilnav.benchmark.studies.calibration`` measures them.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from surveilnav.perception.vocabulary import COCO

Floats = NDArray[np.float64]

#: What ease depends on, in the order of every row of weights.
FEATURES = ("one", "size", "size_squared", "range", "hidden", "cut", "elevation", "camera", "camera_size")
#: Wrong names depend on how large a thing shows: bands of visible size [rad], by their lower ends.
BANDS_RAD = (0.0, 0.2, 0.4, 0.6)
#: Kinds of view and bands, as ``sights`` names them.
SIGHTS = tuple(f"{view} {low_rad}" for view in ("robot", "camera") for low_rad in BANDS_RAD)
_SIZE_RAD = 0.15
_CLEAR_RAD = 0.4  # what shows as large tells all about a room that it can tell
_WAVES = 12  # Fourier features of a field
_ROUND = {"splitmix": (0xBF58476D1CE4E5B9, 0x94D049BB133111EB), "step": (0x9E3779B97F4A7C15,)}


def features(
    size_rad: Floats, range_m: Floats, hidden: Floats, cut: Floats, elevation_rad: Floats, camera: bool
) -> Floats:
    """(N, len(FEATURES)) of N things: square root of the solid angle that shows, distance, share of the outline behind
    which it goes on, sides at the picture's edge, angle of sight below the horizon; ``camera``: not a robot's view."""
    size = np.clip(np.log(size_rad / _SIZE_RAD), -2.5, 2.0)
    one, camera_ = np.ones_like(size), np.full_like(size, float(camera))
    range_ = np.log(np.clip(range_m, 0.4, 12.0) / 2.5)
    return np.stack(
        [one, size, size**2, range_, hidden, cut / 2, np.sin(elevation_rad), camera_, camera_ * size], axis=-1
    )


def visible_rad(x: Floats) -> Floats:
    """(N,) of (N, F) features, how large each thing shows [rad]."""
    return np.asarray(_SIZE_RAD * np.exp(x[:, FEATURES.index("size")]))


def sights(x: Floats) -> list[str]:
    """Of (N, F) features, the kind of view and the band of visible size, for instance "robot 0.2"."""
    band = np.searchsorted(BANDS_RAD, visible_rad(x), side="right") - 1
    camera = x[:, FEATURES.index("camera")] > 0
    return [SIGHTS[i] for i in (band + camera * len(BANDS_RAD)).tolist()]


class Luck(msgspec.Struct, frozen=True):
    """Shares of the variance of luck (the single view has the rest), and how far a field's values are alike."""

    instance: float
    field: float
    angle_rad: float
    range_ratio: float


class Kind(msgspec.Struct, frozen=True):
    """One kind of thing. ``weights``: of ``FEATURES`` by class, "" for all others; ``luck``: of finding.

    ``own``, ``own_luck``: the same for being called by its own name, for things that have one. ``names``: what things of
    a class are called else, and how often, by ``sights``; ``name_kept``: how often an instance's name is its own draw, not the
    view's.
    ``scores``: (ease, score); ``certainty``: quantiles of the name's share in the scores of all classes; ``boxes``:
    measured ones, by size: corners relative to the visible thing's box, or (width, height) [m] for places. These three
    for "right" and "wrong" names, boxes also for those wrong names that were seen often.
    """

    weights: dict[str, list[float]]
    luck: Luck
    names: dict[str, dict[str, dict[str, float]]]
    name_kept: float
    scores: dict[str, list[tuple[float, float]]]
    certainty: dict[str, list[float]]
    boxes: dict[str, list[list[float]]]
    own: dict[str, list[float]] = {}
    own_luck: Luck = Luck(0.0, 0.0, 1.0, 2.0)

    def ease(self, x: Floats, labels: Iterable[str]) -> Floats:
        """(N,) expected ease of things with features (N, F)."""
        return _weighted(x, labels, self.weights)

    def own_ease(self, x: Floats, labels: Iterable[str]) -> Floats:
        """(N,) the same for being called by its own name."""
        return _weighted(x, labels, self.own)

    def score(self, ease: Floats, right: bool) -> Floats:
        """(N,) the detector's scores at some ease; below the lowest one that it reports where ease < 0."""
        knots = np.array(self.scores["right" if right else "wrong"])
        return np.asarray(np.interp(ease, knots[:, 0], knots[:, 1]))

    def rest(self, label: str, sight: str) -> Floats:
        """(80,) what classes share the scores that a thing's name leaves: those that it is mistaken for, and its own."""
        rest = np.zeros(len(COCO))
        for name, share in self.names_of(label, sight).items():
            rest[COCO.index(name)] += share
        if label in COCO:
            rest[COCO.index(label)] += rest.sum()
        return rest

    def names_of(self, label: str, sight: str) -> dict[str, float]:
        """What a thing of a class is called else, and how often."""
        names = self.names[sight]
        return names.get(label) or names[""]

    def called(self, label: str, sight: str, lucks: Floats) -> list[str]:
        """Wrong names of a thing, the drawn one first. ``lucks``: (80,) numbers in (0, 1), one for every class.

        A race: a name's time is exponential with its share as the rate, so it comes first as often as its share; and
        the same lucks draw the same name from shares that are much alike.
        """
        shares = self.names_of(label, sight)
        times = {name: -math.log(lucks[COCO.index(name)]) / share for name, share in shares.items() if name != label}
        return sorted(times, key=lambda name: times[name])


def _weighted(x: Floats, labels: Iterable[str], weights: dict[str, list[float]]) -> Floats:
    if not len(x):
        return np.zeros(0)
    rows = np.array([weights.get(label) or weights[""] for label in labels])
    return np.asarray((x * rows).sum(axis=1))


class Haze(msgspec.Struct, frozen=True):
    """The presence that weak scores suggest for a class in views that don't show it.

    Attributes:
        quantiles: of that presence over such views.
        beside: by label of what else shows (``showing``), by how many standard deviations it raises the presence.
        camera: the same for being a surveillance camera's view. mean: of both together.
        luck: standard deviation of what these don't explain.
    """

    quantiles: list[float]
    beside: dict[str, float]
    camera: float
    mean: float
    luck: float

    def more(self, shown: dict[str, float], camera: bool) -> float:
        """How many standard deviations stronger than usual the weak scores of the class are in a view that shows ``shown``."""
        return (
            sum(self.beside.get(label, 0.0) * share for label, share in shown.items())
            + self.camera * camera
            - self.mean
        )


def showing(labels: Iterable[str], x: Floats) -> dict[str, float]:
    """By label of things with features (N, F), 0 to 1: how large the largest shows."""
    shown: dict[str, float] = {}
    for label, clear in zip(labels, clearness(x).tolist(), strict=True):
        shown[label] = max(clear, shown.get(label, 0.0))
    return shown


def clearness(x: Floats) -> Floats:
    """(N,) of (N, F) features, 0 to 1: how much of what a thing can tell of its room it tells at the size it shows."""
    return np.minimum(visible_rad(x) / _CLEAR_RAD, 1.0)


class ErrorModel(msgspec.Struct, frozen=True):
    """All kinds: ``thing`` has a name that the detector knows, ``other`` has none, ``place`` is a piece of a surface.

    ``haze``: by class.
    """

    what: str
    source: str
    min_score: float
    min_size_rad: float
    kinds: dict[str, Kind]
    haze: dict[str, Haze] = {}


@lru_cache(maxsize=1)
def error_model() -> ErrorModel:
    """data/simulated_errors.json."""
    return read(Path(__file__).parent / "data" / "simulated_errors.json")


def read(path: Path) -> ErrorModel:
    """The model in a file that ``surveilnav.benchmark.studies.calibration.run`` wrote."""
    return msgspec.json.decode(path.read_bytes(), type=ErrorModel)


# --- luck -----------------------------------------------------------------------------------------------------------


def hashed(seed: int, names: object) -> int:
    """64 bits that depend on a seed and names, the same on every machine."""
    return int.from_bytes(hashlib.sha256(repr((seed, names)).encode()).digest()[:8], "little")


def uniforms(seed: int, ids: NDArray[np.uint64], channel: int, n: int = 1) -> Floats:
    """(len(ids), n) numbers in (0, 1), by splitmix64 (Steele et al. 2014) of seed, id, channel and column."""
    columns = np.arange(n, dtype=np.uint64) + np.uint64(channel << 32)
    with np.errstate(over="ignore"):
        z = _mixed(_mixed(ids + np.uint64(seed))[:, None] + columns)
    return ((z >> np.uint64(11)).astype(np.float64) + 0.5) / 2.0**53


def _mixed(z: NDArray[np.uint64]) -> NDArray[np.uint64]:
    a, b = _ROUND["splitmix"]
    z = z + np.uint64(_ROUND["step"][0])
    z = (z ^ (z >> np.uint64(30))) * np.uint64(a)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(b)
    return z ^ (z >> np.uint64(31))


@dataclass(frozen=True, slots=True, eq=False)
class Draws:
    """Where luck comes from in one view: ``scene`` and ``view`` are seeds, ``ids`` (N,) name the things.

    ``direction`` (N, 3) are unit vectors from the things to the camera in the world, ``range_m`` (N,).
    """

    scene: int
    view: int
    ids: NDArray[np.uint64]
    direction: Floats
    range_m: Floats

    def luck(self, luck: Luck, channel: int) -> Floats:
        """(N,) standard normal lucks of one channel, alike from view to view as ``luck`` says."""
        own = ndtri(uniforms(self.scene, self.ids, 3 * channel))[:, 0]
        view = ndtri(uniforms(self.view, self.ids, channel))[:, 0]
        rest = max(0.0, 1.0 - luck.instance - luck.field)
        return np.asarray(
            np.sqrt(luck.instance) * own + np.sqrt(luck.field) * self._field(luck, channel) + np.sqrt(rest) * view
        )

    def _field(self, luck: Luck, channel: int) -> Floats:
        at = np.concatenate(
            [self.direction / luck.angle_rad, (np.log(self.range_m) / np.log(luck.range_ratio))[:, None]], axis=1
        )
        waves = ndtri(uniforms(self.scene, self.ids, 3 * channel + 1, 4 * _WAVES)).reshape(-1, _WAVES, 4)
        phases = 2 * np.pi * uniforms(self.scene, self.ids, 3 * channel + 2, _WAVES)
        return np.asarray(np.sqrt(2 / _WAVES) * np.cos((waves * at[:, None]).sum(axis=-1) + phases).sum(axis=-1))
