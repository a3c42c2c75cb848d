"""The joint object map of a storey: detections become points, points become objects, objects gather evidence."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from services.fusion.core.association import (
    BoxTable,
    Shape,
    apart,
    box_iou,
    box_overlap,
    cosine,
    evenly,
    overlaps,
    voxel_iou,
)
from services.fusion.core.config import ObjectConfig
from services.fusion.core.evidence import Evidence, Status, Support, judge
from services.fusion.core.sightings import Sighting, locate_all
from services.fusion.core.sizes import misfit, outgrown
from services.fusion.core.visibility import in_plain_view
from surveilnav.messages.maps import ObjectEvent, ObjectRecord
from surveilnav.sensing.views import Detected, PosedView

_RECORD_POINTS = 256


@dataclass(frozen=True, slots=True)
class Happened:
    """News of an object; ``absorbed``: the object that was found to be the same, 0 for none."""

    object_id: int
    event: ObjectEvent
    absorbed: int = 0


_PLAIN = (
    "id", "embedding_sum", "seen_from_sum", "first_seen_ns", "last_seen_ns", "label", "confidence", "status", "reason",
    "n_detections", "changed",
)  # fmt: skip
What = Literal["created", "matched", "merged", "confirmed", "rejected", "flipped", "not_seen"]


@dataclass(slots=True, eq=False)
class MapObject:
    """One object. ``embedding_sum``: of its detections' unit embeddings: in direction their count-weighted mean;
    ``seen_from_sum``: of the horizontal unit vectors (2,) from each detection to who made it."""

    id: int
    shape: Shape
    embedding_sum: NDArray[np.float32]
    seen_from_sum: NDArray[np.float64]
    first_seen_ns: int
    last_seen_ns: int
    label: str
    confidence: float = 0.0
    status: Status = "candidate"
    reason: str = ""
    evidence: Evidence = field(default_factory=Evidence)
    sources: set[str] = field(default_factory=set)
    n_detections: int = 0
    history: deque[ObjectEvent] = field(default_factory=deque)
    changed: bool = True  # since duplicates were last searched for
    record: ObjectRecord | None = None  # as others see it, until something happens to it


class _Objects(dict[int, MapObject]):
    """Objects by id, and where they are. One whose shape has changed is put back."""

    def __init__(self) -> None:
        super().__init__()
        self.boxes = BoxTable()

    def __setitem__(self, id_: int, obj: MapObject) -> None:
        super().__setitem__(id_, obj)
        self.boxes.put(id_, obj.shape)

    def __delitem__(self, id_: int) -> None:
        super().__delitem__(id_)
        self.boxes.drop(id_)


class ObjectMap:
    """All objects of a storey."""

    def __init__(self, floor: str, floor_z_m: float, voxel_m: float, config: ObjectConfig) -> None:
        self._floor = floor
        self._floor_z_m = floor_z_m
        self._voxel_m = voxel_m
        self._config = config
        self._objects = _Objects()
        self._next_id = 1
        self._views = 0
        self._news: list[Happened] = []

    def __len__(self) -> int:
        return len(self._objects)

    def integrate(self, view: PosedView, detections: tuple[Detected, ...]) -> int:
        """Adds what a detector saw in a view (nothing is a statement, too); returns how many detections had a place."""
        # masks -> points in the world
        sightings = locate_all(view, detections, self._voxel_m, self._config)
        self.add(view, detections, sightings)
        return len(sightings)

    def add(self, view: PosedView, detections: tuple[Detected, ...], sightings: Sequence[Sighting]) -> None:
        """``integrate`` with the detections that have a place already found, strongest first."""
        # eq. 3: each detection joins the most similar object or starts a new one
        seen: set[tuple[int, str]] = set()
        for sighting in sightings:
            self._associate(view, sighting, seen)
        # negative evidence: what should have been seen and wasn't
        if view.is_robot:
            self._note_misses(view, detections, {object_id for object_id, _ in seen})
        self._views += 1
        if self._views % self._config.merge_every == 0:
            self._merge_duplicates(view)
        self._forget_weakest()

    @property
    def shape_bytes(self) -> int:
        """Memory that the objects' voxels take."""
        return sum(o.shape.keys.nbytes + o.shape.coarse.nbytes for o in self._objects.values())

    def take_news(self) -> list[Happened]:
        """What happened to objects since the last call."""
        news, self._news = self._news, []
        return news

    def state(self) -> dict[str, Any]:
        """All of it, as plain arrays and values, for ``of_state``."""
        return {
            "next_id": self._next_id, "views": self._views,
            "objects": [
                {
                    "keys": o.shape.keys, "evidence": o.evidence.state(), "sources": sorted(o.sources),
                    "history": list(o.history), **{name: getattr(o, name) for name in _PLAIN},
                }
                for o in self._objects.values()
            ],
        }  # fmt: skip

    @classmethod
    def of_state(
        cls, state: dict[str, Any], floor: str, floor_z_m: float, voxel_m: float, config: ObjectConfig
    ) -> ObjectMap:
        """The object map that ``state`` was taken of."""
        objects = cls(floor, floor_z_m, voxel_m, config)
        objects._next_id, objects._views = state["next_id"], state["views"]
        for o in state["objects"]:
            history = deque(msgspec.convert(o["history"], list[ObjectEvent]), maxlen=config.max_history)
            objects._objects[o["id"]] = MapObject(
                shape=Shape(o["keys"], voxel_m, config.overlap_voxel_m), evidence=Evidence.of_state(o["evidence"]),
                sources=set(o["sources"]), history=history, **{name: o[name] for name in _PLAIN},
            )  # fmt: skip
        return objects

    def records(self) -> list[ObjectRecord]:
        """The objects as others may see them, by id."""
        return [self._record(o) for _, o in sorted(self._objects.items())]

    def similarity(self, shape: Shape, embedding: NDArray[np.float32], other: MapObject) -> tuple[float, float]:
        """(s, mutual): eq. 3's weighted sum, and the smaller of both overlaps."""
        c = self._config
        looks = c.w_visual * cosine(embedding, other.embedding_sum)
        if apart(shape, other.shape, 2 * c.overlap_voxel_m):
            return looks, 0.0
        there, back = overlaps(shape, other.shape)
        geometric = {
            "overlap": lambda: max(there, back), "box_iou": lambda: box_iou(shape, other.shape),
            "voxel_iou": lambda: voxel_iou(shape, other.shape),
        }[c.geometry]()  # fmt: skip
        return looks + c.w_geometric * geometric, min(there, back)

    def _associate(self, view: PosedView, sighting: Sighting, seen: set[tuple[int, str]]) -> None:
        c, detected = self._config, sighting.detected
        scored = [(*self.similarity(sighting.shape, detected.embedding, o), o) for o in self._around(sighting.shape)]
        for s, mutual, candidate in sorted(scored, key=lambda item: (-max(item[0], _sure(item, c)), item[2].id)):
            if (s < c.tau and mutual < c.tau_mutual) or self._outgrows(
                candidate.label, candidate.shape, sighting.shape
            ):
                continue
            if mutual < c.tau_mutual and self._outgrows(detected.label, sighting.shape, candidate.shape):
                continue  # a tv on a cupboard is no part of it
            if c.once_per_view and (candidate.id, detected.label) in seen:
                if mutual >= min(c.tau_mutual, 1.0):
                    return  # the same thing twice in one picture
                continue
            self._add_to(candidate, view, sighting, "matched", f"s = {s:.2f}")
            seen.add((candidate.id, detected.label))
            return
        new = MapObject(
            id=self._next_id, shape=sighting.shape, label=detected.label,
            embedding_sum=np.zeros_like(detected.embedding), seen_from_sum=np.zeros(2),
            first_seen_ns=view.stamp_ns, last_seen_ns=view.stamp_ns, history=deque(maxlen=c.max_history),
        )  # fmt: skip
        self._next_id += 1
        self._add_to(new, view, sighting, "created", "")
        seen.add((new.id, detected.label))

    def _add_to(self, obj: MapObject, view: PosedView, sighting: Sighting, what: What, note: str) -> None:
        """Fuses a detection into an object: points, embedding, evidence."""
        c, detected = self._config, sighting.detected
        obj.shape = obj.shape.union(sighting.shape, c.max_voxels)
        self._objects[obj.id] = obj
        if obj.embedding_sum.shape == detected.embedding.shape:
            obj.embedding_sum = obj.embedding_sum + detected.embedding
        obj.seen_from_sum = obj.seen_from_sum + _towards(view, sighting.shape)
        obj.first_seen_ns = min(obj.first_seen_ns, view.stamp_ns)
        obj.last_seen_ns = max(obj.last_seen_ns, view.stamp_ns)
        obj.n_detections += 1
        obj.sources.add(view.source)
        obj.changed = True
        supports = obj.evidence.robot if view.is_robot else obj.evidence.surveillance
        weight = min(1.0, (c.near_m / max(sighting.range_m, 1e-6)) ** 2)
        near = view.is_robot and sighting.range_m <= c.near_m
        supports.setdefault(detected.label, Support()).add(detected.score, weight, near, _place(view))
        self._log(obj, view, detected.label, detected.score, what, note, detected.box_px)
        self._judge(obj, view)

    def _judge(self, obj: MapObject, view: PosedView) -> None:
        obj.record = None
        before, flipped = obj.status, obj.evidence.flipped
        verdict = judge(obj.evidence, before, self._config)
        obj.label, obj.confidence = verdict.label, verdict.confidence
        obj.status, obj.reason = verdict.status, verdict.reason
        if unfit := self._unfit(obj, obj.label):
            obj.confidence *= self._config.misfit_factor
            if obj.status == "confirmed":
                obj.status, obj.reason = "candidate", unfit
        if obj.evidence.flipped != flipped:
            self._log(obj, view, obj.label, obj.confidence, "flipped", obj.reason)
        elif obj.status != before and obj.status != "candidate":
            self._log(obj, view, obj.label, obj.confidence, obj.status, obj.reason)

    def _outgrows(self, label: str, shape: Shape, more: Shape) -> bool:
        """Whether a thing would be too large for its class with more points, and isn't yet: then they aren't its own."""
        if not self._config.size_prior or outgrown(label, *self._extent(shape.p_min, shape.p_max)):
            return False
        low, high = np.minimum(shape.p_min, more.p_min), np.maximum(shape.p_max, more.p_max)
        return bool(outgrown(label, *self._extent(low, high)))

    def _extent(
        self, p_min: NDArray[np.float64], p_max: NDArray[np.float64]
    ) -> tuple[tuple[float, float, float], float]:
        """Size and top above the floor [m] of a box."""
        return _triple(p_max - p_min), float(p_max[2]) - self._floor_z_m

    def _unfit(self, obj: MapObject, label: str) -> str:
        return misfit(label, *self._extent(obj.shape.p_min, obj.shape.p_max)) if self._config.size_prior else ""

    def _note_misses(self, view: PosedView, detections: tuple[Detected, ...], seen: set[int]) -> None:
        c = self._config
        before = (self._objects[i] for i in self._objects.boxes.before(view.T_world_camera, c.miss_far_m + 1.0))
        objects = [o for o in before if o.id not in seen and o.status != "rejected"]
        shares, pixels = in_plain_view(view, [o.shape.samples for o in objects], c.miss_near_m, c.miss_far_m)
        for obj, share, pixel in zip(objects, shares, pixels, strict=True):
            if share < c.miss_visible or any(
                d.label == obj.label and d.score >= c.min_score and _holds(d, pixel) for d in detections
            ):
                continue
            obj.evidence.misses += 1
            self._log(obj, view, obj.label, 0.0, "not_seen", f"{share:.0%} of its points in plain view")
            self._judge(obj, view)

    def _merge_duplicates(self, view: PosedView) -> None:
        """Joins objects that turned out to be one. Looks only at those that changed: no spike as the map grows."""
        c = self._config
        for obj in [o for _, o in sorted(self._objects.items()) if o.changed]:
            obj.changed = False
            if obj.id not in self._objects:
                continue
            for other in self._around(obj.shape):
                if other.id == obj.id:
                    continue
                there, back = overlaps(obj.shape, other.shape)
                alike = cosine(obj.embedding_sum, other.embedding_sum) >= c.merge_visual
                together = max(there, back) >= c.merge_overlap or box_overlap(obj.shape, other.shape) >= c.merge_box
                if min(there, back) < c.tau_mutual and not (alike and together):
                    continue
                kept, gone = (obj, other) if obj.id < other.id else (other, obj)
                if any(self._outgrows(a.label, a.shape, b.shape) for a, b in ((obj, other), (other, obj))):
                    continue
                self._absorb(kept, gone, view)
                if gone is obj:
                    break

    def _absorb(self, kept: MapObject, gone: MapObject, view: PosedView) -> None:
        c = self._config
        kept.shape = kept.shape.union(gone.shape, c.max_voxels)
        self._objects[kept.id] = kept
        if kept.embedding_sum.shape == gone.embedding_sum.shape:
            kept.embedding_sum = kept.embedding_sum + gone.embedding_sum
        kept.seen_from_sum = kept.seen_from_sum + gone.seen_from_sum
        kept.first_seen_ns = min(kept.first_seen_ns, gone.first_seen_ns)
        kept.last_seen_ns = max(kept.last_seen_ns, gone.last_seen_ns)
        kept.n_detections += gone.n_detections
        kept.sources |= gone.sources
        kept.evidence.absorb(gone.evidence)
        kept.history = deque(sorted([*kept.history, *gone.history], key=lambda e: e.stamp_ns), maxlen=c.max_history)
        del self._objects[gone.id]
        self._log(
            kept, view, gone.label, gone.confidence, "merged", f"object {gone.id} was the same thing", absorbed=gone.id
        )
        self._judge(kept, view)

    def _forget_weakest(self) -> None:
        while len(self._objects) > self._config.max_objects:
            of_worth = (
                ((o.status == "confirmed", o.confidence, o.last_seen_ns, i), i) for i, o in self._objects.items()
            )
            del self._objects[min(of_worth)[1]]

    def _around(self, shape: Shape) -> list[MapObject]:
        """Objects that may reach the threshold: near ones only, unless looks alone would do."""
        if self._config.w_visual >= self._config.tau:
            return [o for _, o in sorted(self._objects.items())]
        return [self._objects[i] for i in self._objects.boxes.touching(shape, 2 * self._config.overlap_voxel_m)]

    def _log(
        self, obj: MapObject, view: PosedView, label: str, score: float, what: What, note: str,
        box_px: tuple[float, float, float, float] | None = None, absorbed: int = 0,
    ) -> None:  # fmt: skip
        event = ObjectEvent(
            view.stamp_ns, view.source, view.view, view.seq, label, round(float(score), 4), what, note, box_px
        )
        obj.history.append(event)
        self._news.append(Happened(obj.id, event, absorbed))

    def _record(self, o: MapObject) -> ObjectRecord:
        """As others may see it; made anew only after something happened to it (``_judge``)."""
        o.record = o.record or self._recorded(o)
        return o.record

    def _recorded(self, o: MapObject) -> ObjectRecord:
        c, points = self._config, o.shape.points
        every = evenly(len(points), _RECORD_POINTS)
        robot, cameras = o.evidence.confidences(True, c), o.evidence.confidences(False, c)
        (label_robot, by_robot), (label_cameras, by_cameras) = o.evidence.best(True, c), o.evidence.best(False, c)
        scores = {label: max(robot.get(label, 0.0), cameras.get(label, 0.0)) for label in sorted({*robot, *cameras})}
        return ObjectRecord(
            id=o.id, floor=self._floor, label=o.label, status=o.status, confidence=o.confidence,
            confidence_robot=by_robot, confidence_surveillance=by_cameras, label_robot=label_robot,
            label_surveillance=label_cameras, n_detections=o.n_detections, n_points=len(points),
            center_m=_triple((o.shape.p_min + o.shape.p_max) / 2), size_m=_triple(o.shape.p_max - o.shape.p_min),
            first_seen_ns=o.first_seen_ns, last_seen_ns=o.last_seen_ns, sources=sorted(o.sources), reason=o.reason,
            points=points[every].astype(np.float32).tobytes(), history=list(o.history),
            label_scores={k: v * (c.misfit_factor if self._unfit(o, k) else 1.0) for k, v in scores.items()},
            seen_from=(float(o.seen_from_sum[0]) / o.n_detections, float(o.seen_from_sum[1]) / o.n_detections),
        )  # fmt: skip


def _sure(item: tuple[float, float, MapObject], config: ObjectConfig) -> float:
    """Overlap both ways counts as much as looks and place together."""
    return config.tau + item[1] if item[1] >= config.tau_mutual else -math.inf


def _place(view: PosedView) -> tuple[object, ...]:
    """Where a view was taken from: a camera's view, or a robot's position to 0.25 m and direction to 15 degrees."""
    if not view.is_robot:
        return view.source, view.view
    x, y, _ = view.T_world_camera[:3, 3]
    forward = view.T_world_camera[:3, 2]
    yaw = math.atan2(forward[1], forward[0])
    return view.source, round(float(x) / 0.25), round(float(y) / 0.25), round(yaw / math.radians(15)) % 24


def _towards(view: PosedView, shape: Shape) -> NDArray[np.float64]:
    """The horizontal unit vector (2,) from a detection's middle to its camera; nothing right above or below."""
    way: NDArray[np.float64] = view.T_world_camera[:2, 3] - (shape.p_min + shape.p_max)[:2] / 2
    length_m = float(np.linalg.norm(way))
    return way / length_m if length_m > 1e-6 else np.zeros(2)


def _holds(detected: Detected, pixel: NDArray[np.float64]) -> bool:
    x0, y0, x1, y1 = detected.box_px
    return bool(x0 <= pixel[0] <= x1 and y0 <= pixel[1] <= y1)


def _triple(v: NDArray[np.float64]) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])
