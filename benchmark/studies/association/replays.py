"""Recorded views through the object map, in one configuration or another, and how good its objects are."""

from __future__ import annotations

import hashlib
import time
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from surveilnav.benchmark.studies.recordings import TOURS, Recording, SeenView, Thing
from surveilnav.messages.maps import ObjectRecord
from surveilnav.perception.vocabulary import COCO
from surveilnav.services.fusion.core import FusionConfig, ObjectConfig, in_order
from surveilnav.services.fusion.core.config import (
    AssociationConfig,
    FalsePositiveConfig,
    PointsConfig,
)
from surveilnav.services.fusion.core.objects.localization import LocatedDetection, locate_all
from surveilnav.services.fusion.core.objects.object_map import ObjectMap

SEED = 3  # of the furniture: neither that of the table of searches (0, 1) nor of the detectors' thresholds (7, 8)
VOXEL_M = 0.025
GOOD_SHARE = 0.5  # a detection shows an instance if at least so much of its mask does
MERGED_SHARE = 0.2  # an object holds an instance if at least so much of its detections shows it
SEEN_DETECTIONS = 2
BESIDE_M = 0.5  # a robot sent to an object so near to an instance of its class finds the instance


# --- replays ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class MapResult:
    """What came of a replay: every object with (instance, share) of each of its detections."""

    objects: list[tuple[ObjectRecord, list[tuple[int, float]]]]
    cpu_ms: list[float]
    shape_bytes: int


class Player:
    """Replays a recording, one floor at a time and in the order of integration; masks become points once per setting."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        by_view = {id(seen.view): seen for seen in recording.views}
        asked = [seen.view for seen in recording.views if seen.perception is not None]
        self._views = [by_view[id(view)] for view in in_order(asked)]
        self._truth = {
            (*_name(seen), d.label, round(d.score, 4), d.box_px): truth
            for seen in self._views
            for d, truth in zip(_detections(seen), seen.truth, strict=True)
        }
        self._located = lru_cache(maxsize=2)(self._locate)
        self.locate_ms = 0.0  # CPU a view to turn masks into points, of the settings last met

    def play(self, config: ObjectConfig) -> MapResult:
        """All views through one configuration. CPU time leaves out turning masks into points."""
        config = config.model_copy(update={"max_history": 1_000_000})
        maps: dict[str, ObjectMap] = {}
        cpu_ms = []
        for seen, located in self._located(config.points, config.association.overlap_voxel_m):
            name, z_m = seen.view.floor, seen.view.floor_z_m
            floor = maps.setdefault(name, ObjectMap(name, z_m, VOXEL_M, config))
            began_s = time.process_time()
            floor.add_located(seen.view, _detections(seen), located)
            cpu_ms.append(1e3 * (time.process_time() - began_s))
        objects = [(o, self._truths_of(o)) for m in maps.values() for o in m.records()]
        return MapResult(objects, cpu_ms, sum(m.shape_bytes for m in maps.values()))

    def _locate(self, points: PointsConfig, overlap_voxel_m: float) -> list[tuple[SeenView, list[LocatedDetection]]]:
        config, began_s = _object_config({"overlap_voxel_m": overlap_voxel_m}, points=points), time.process_time()
        located = [(seen, locate_all(seen.view, _detections(seen), VOXEL_M, config)) for seen in self._views]
        self.locate_ms = 1e3 * (time.process_time() - began_s) / len(self._views)
        return located

    def _truths_of(self, record: ObjectRecord) -> list[tuple[int, float]]:
        return [
            self._truth[e.source, e.view, e.seq, e.label, e.score, e.box_px]
            for e in record.history
            if e.box_px is not None
        ]


def _name(seen: SeenView) -> tuple[str, int, int]:
    return seen.view.source, seen.view.view, seen.view.seq


def _detections(seen: SeenView) -> tuple[Any, ...]:
    return seen.perception.detections if seen.perception is not None else ()


def _object_config(association: Mapping[str, Any], **parts: Any) -> ObjectConfig:
    """The default with these settings of association, and these parts instead."""
    return ObjectConfig(association=AssociationConfig(**association), **parts)


# --- scores -------------------------------------------------------------------------------------------------------


def good_detections(recording: Recording, min_score: float = 0.25) -> dict[int, int]:
    """How many detections show each instance: at least ``GOOD_SHARE`` of the mask."""
    counts: dict[int, int] = defaultdict(int)
    for seen in recording.views:
        for d, (instance, share) in zip(_detections(seen), seen.truth, strict=True):
            if instance and share >= GOOD_SHARE and d.score >= min_score:
                counts[instance] += 1
    return counts


@dataclass(slots=True)
class _Row:
    """What became of an instance. ``best``: (weight, error of the centre [m]) of the object that shows most of it."""

    kept: int = 0
    all: int = 0
    confirmed: int = 0
    same: int = 0
    cross: int = 0
    held: bool = False
    best: tuple[float, float] = (0.0, 0.0)


def score(
    things: dict[int, Thing], good: dict[int, int], found: Iterable[tuple[ObjectRecord, list[tuple[int, float]]]]
) -> dict[str, Any]:
    """What a table needs of one replay.

    ``things``: a row per instance of a COCO class that at least two good detections show: [class, good detections,
    objects of at least two detections, all objects, objects confirmed as its class, wrong merges within the class,
    wrong merges across classes, held by any object of at least two detections, error of the centre in metres or None].
    ``served``: for "label > what it is", how many objects of at least two detections and how many ever confirmed.
    """
    rows = {i: _Row() for i, n in good.items() if n >= SEEN_DETECTIONS and things[i].label in COCO}
    served: dict[str, list[int]] = defaultdict(lambda: [0, 0])
    for obj, truths in found:
        shares: dict[int, float] = defaultdict(float)
        for instance, share in truths:
            shares[instance] += share
        owner = max(sorted(shares), key=lambda i: shares[i])
        what = things[owner].label if owner else "background"
        confirmed = {e.label for e in obj.history if e.what == "confirmed"}
        kept = len(truths) >= SEEN_DETECTIONS
        for label in confirmed | ({obj.label} if kept else set()):
            shown = _nearest(obj, label, things) if label in confirmed and label != what else None
            entry = served[f"{label} > {things[shown].label if shown else what}"]
            entry[0] += kept and label == obj.label
            entry[1] += label in confirmed
            if label in confirmed and (i := shown or owner) in rows and things[i].label == label:
                rows[i].confirmed += 1
        if row := rows.get(owner):
            row.all += 1
            row.kept += kept
            error_m = float(np.linalg.norm(np.subtract(obj.center_m, _middle(things[owner]))))
            row.best = max(row.best, (shares[owner], error_m))
        if not kept:
            continue
        held = [i for i in rows if shares.get(i, 0.0) >= MERGED_SHARE * sum(shares.values())]
        for i in held:
            rows[i].held = True
        if len(held) >= 2:
            first, second = sorted(held, key=lambda i: (-shares[i], i))[:2]
            alike = things[first].label == things[second].label
            rows[first].same += alike
            rows[first].cross += not alike
    return {
        "things": [
            [
                things[i].label,
                good[i],
                r.kept,
                r.all,
                r.confirmed,
                r.same,
                r.cross,
                int(r.held),
                round(r.best[1], 3) if r.all else None,
            ]
            for i, r in sorted(rows.items())
        ],
        "served": dict(sorted(served.items())),
    }


def _nearest(record: ObjectRecord, label: str, things: dict[int, Thing]) -> int | None:
    """The instance of a class whose box is nearest to an object's middle, if it is within ``BESIDE_M``."""
    beside = [
        (float(np.linalg.norm(np.clip(record.center_m, t.p_min, t.p_max) - record.center_m)), t.id)
        for t in things.values()
        if t.label == label
    ]
    distance_m, nearest = min(beside, default=(np.inf, 0))
    return nearest if distance_m <= BESIDE_M else None


def _middle(thing: Thing) -> tuple[float, ...]:
    return tuple((a + b) / 2 for a, b in zip(thing.p_min, thing.p_max, strict=True))


# --- what is compared ---------------------------------------------------------------------------------------------

GEOMETRIES = ("box_iou", "voxel_iou", "overlap")
TAUS = (0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5)
#: What finds duplicates beside eq. 3: nothing; ConceptGraphs' and VLN-Game's periodic merge; all rules of the default.
#: Only the last looks at sizes.
RULES: dict[str, dict[str, Any]] = {
    "eq. 3 alone": {"tau_mutual": None, "merge_every": None},
    "with merge": {
        "tau_mutual": None,
        "merge_every": 20,
        "merge_overlap": 0.7,
        "merge_visual": 0.7,
        "merge_box": None,
    },
    "all rules": {},
}
#: Settings of points and association, and what else they are tried with.
CHANGES: tuple[tuple[str, tuple[Any, ...]], ...] = (
    ("tau_mutual", (0.5, None)),
    ("merge_every", (1, 10, 20)),
    ("merge_box", (0.4, 0.6, None)),
    ("merge_overlap", (0.4, 0.8)),
    ("merge_visual", (0.7, 0.85)),
    ("overlap_voxel_m", (0.025, 0.075)),
    ("dbscan_eps_pixels", (0.0, 2.0, 4.0)),
    ("dbscan_eps_m", (0.08,)),
    ("max_points", (500, 2000)),
)


@dataclass(frozen=True, slots=True)
class Variant:
    """One way to make objects of detections. ``group``: the table it belongs to."""

    group: str
    name: str
    config: ObjectConfig

    @property
    def fingerprint(self) -> str:
        """Of its settings."""
        return hashlib.sha256(self.config.model_dump_json().encode()).hexdigest()[:12]


def variants(tour: str) -> list[Variant]:
    """Everything that is replayed on a tour: on the first all of it, on others what was near the choice."""
    first = tour == next(iter(TOURS))
    found = [
        Variant("preset", "default", ObjectConfig()),
        Variant("preset", "paper", FusionConfig.preset("paper").objects),
    ]
    for rules, settings in RULES.items():
        for geometry in GEOMETRIES:
            for tau in TAUS:
                if first or (tau > 1.0 and rules != "eq. 3 alone"):
                    sizes = FalsePositiveConfig(size_prior=rules == "all rules")
                    config = _object_config({"geometry": geometry, "tau": tau, **settings}, false_positives=sizes)
                    found.append(Variant("sweep", f"{geometry} {tau} {rules}", config))
    for name, values in CHANGES:
        found += [Variant("change", f"{name} {value}", _changed(name, value)) for value in values]
    return found


def _changed(name: str, value: Any) -> ObjectConfig:
    """The default with one number of points or association changed."""
    if name in PointsConfig.model_fields:
        return ObjectConfig(points=PointsConfig(**{name: value}))
    return _object_config({name: value})
