"""The joint object map of a floor: detections become points, points become objects, objects gather evidence.

The paper's section "Joint 3D Object Map and Target Confirmation": masks to points (``sightings``), association
(``association``, eq. 3), fusion (``map_object``), confirmation (``confirmation``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.messages.maps import ObjectEvent, ObjectRecord
from surveilnav.sensing.views import DetectedObject, PosedView
from surveilnav.services.fusion.core.config import AssociationConfig, ObjectConfig
from surveilnav.services.fusion.core.objects.association import (
    Similarity,
    box_overlap,
    cosine,
    overlaps,
    same_place,
    similarity,
)
from surveilnav.services.fusion.core.objects.box_table import BoxTable
from surveilnav.services.fusion.core.objects.confirmation import confirmation_of
from surveilnav.services.fusion.core.objects.localization import Sighting, locate_all
from surveilnav.services.fusion.core.objects.map_object import Change, MapObject, ObjectChange
from surveilnav.services.fusion.core.objects.shape import Shape, evenly
from surveilnav.services.fusion.core.objects.sizes import misfit, outgrown
from surveilnav.services.fusion.core.objects.visibility import in_plain_view

_RECORD_POINTS = 256


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
    """All objects of a floor."""

    def __init__(self, floor: str, floor_z_m: float, voxel_m: float, config: ObjectConfig) -> None:
        self._floor = floor
        self._floor_z_m = floor_z_m
        self._voxel_m = voxel_m
        self._config = config
        self._confirmation = confirmation_of(config)
        self._objects = _Objects()
        self._next_id = 1
        self._views = 0
        self._changes: list[ObjectChange] = []

    def __len__(self) -> int:
        return len(self._objects)

    def add_detections(self, view: PosedView, detections: tuple[DetectedObject, ...], embedding_model: str = "") -> int:
        """Adds what a detector found in a view; returns how many detections could be located.

        What a robot's view doesn't show is evidence, too: an object in plain sight that nothing was detected of.
        """
        # masks -> points in the world
        sightings = locate_all(view, detections, self._voxel_m, self._config, embedding_model)
        self.add_located(view, detections, sightings)
        return len(sightings)

    def add_located(
        self, view: PosedView, detections: tuple[DetectedObject, ...], sightings: Sequence[Sighting]
    ) -> None:
        """``add_detections`` with the detections already located, the strongest first."""
        # eq. 3: each detection joins the most similar object or starts a new one
        seen: set[tuple[int, str]] = set()
        for sighting in sightings:
            self._associate(view, sighting, seen)
        # negative evidence: what should have been seen and wasn't
        if view.is_robot:
            self._record_misses(view, detections, {object_id for object_id, _ in seen})
        # objects that turned out to be one
        self._views += 1
        every = self._config.association.merge_every
        if every is not None and self._views % every == 0:
            self._merge_duplicates(view)
        self._forget_weakest()

    @property
    def shape_bytes(self) -> int:
        """Memory that the objects' voxels take."""
        return sum(o.shape.keys.nbytes + o.shape.coarse.nbytes for o in self._objects.values())

    def misfit(self, object_id: int, label: str) -> str:
        """Why the size of an object isn't that of a class, for people; empty if it is. KeyError: there is no such object."""
        return self._unfit(self._objects[object_id], label)

    def pop_changes(self, revision: int) -> list[ObjectChange]:
        """What happened to objects since the last call; these objects count as changed at ``revision`` (``records``)."""
        changes, self._changes = self._changes, []
        for change in changes:
            if change.object_id in self._objects:
                self._objects[change.object_id].revision = revision
        return changes

    def state(self) -> dict[str, Any]:
        """Everything as plain arrays and values, for ``from_state``."""
        objects = [o.state() for o in self._objects.values()]
        return {"next_id": self._next_id, "views": self._views, "objects": objects}

    @classmethod
    def from_state(
        cls, state: dict[str, Any], floor: str, floor_z_m: float, voxel_m: float, config: ObjectConfig
    ) -> ObjectMap:
        """The object map that ``state`` describes."""
        objects = cls(floor, floor_z_m, voxel_m, config)
        objects._next_id, objects._views = state["next_id"], state["views"]
        for of_object in state["objects"]:
            objects._objects[of_object["id"]] = MapObject.from_state(of_object, voxel_m, config)
        return objects

    # --- association ----------------------------------------------------------------------------------------------

    def _associate(self, view: PosedView, sighting: Sighting, seen: set[tuple[int, str]]) -> None:
        """Adds a detection to its object or to a new one. ``seen``: the (object, class) that this view showed, kept up
        to date."""
        c, label = self._config.association, sighting.detected.label
        for found, candidate in self._matches(sighting):
            if c.once_per_view and (candidate.id, label) in seen:
                if found.mutual >= (1.0 if c.tau_mutual is None else c.tau_mutual):
                    return  # the same thing twice in one picture
                continue
            self._fuse(candidate, view, sighting, "matched", f"s = {found.s:.2f}")
            seen.add((candidate.id, label))
            return
        new = MapObject.of_sighting(self._next_id, view, sighting, self._config.max_history)
        self._next_id += 1
        self._fuse(new, view, sighting, "created", "")
        seen.add((new.id, label))

    def _matches(self, sighting: Sighting) -> list[tuple[Similarity, MapObject]]:
        """The objects that a detection may be of, most similar first: s reaches tau, or both lie in the same place."""
        c, shape, detected = self._config.association, sighting.shape, sighting.detected
        matches = []
        for o in self._around(shape):
            comparable = sighting.embedding_model == o.embedding_model
            found = similarity(shape, detected.embedding, o.shape, o.embedding_sum, c, comparable=comparable)
            together = same_place(found.mutual, c)
            if found.s < c.tau and not together:
                continue
            if self._outgrows(o.label, o.shape, shape):
                continue
            if not together and self._outgrows(detected.label, shape, o.shape):
                continue  # a tv on a cupboard is no part of it
            matches.append((found, o))
        return sorted(matches, key=lambda match: (-_rank(match[0], c), match[1].id))

    def _around(self, shape: Shape) -> list[MapObject]:
        """Objects that may reach the threshold: near ones only, unless looks alone would do."""
        c = self._config.association
        if c.w_visual >= c.tau:
            return [o for _, o in sorted(self._objects.items())]
        return [self._objects[i] for i in self._objects.boxes.touching(shape, 2 * c.overlap_voxel_m)]

    # --- fusion and confirmation ----------------------------------------------------------------------------------

    def _fuse(self, obj: MapObject, view: PosedView, sighting: Sighting, what: Change, note: str) -> None:
        detected = sighting.detected
        obj.fuse(view, sighting, self._config.max_voxels)
        self._objects[obj.id] = obj
        self._log(obj, view, detected.label, detected.score, what, note, detected.box_px)
        self._reassess(obj, view)

    def _reassess(self, obj: MapObject, view: PosedView) -> None:
        """Has the rule of confirmation look at an object anew."""
        obj.record = None
        before, flipped = obj.status, obj.evidence.flipped
        self._confirmation.settle(obj.evidence)
        now = self._confirmation.assess(obj.evidence, before)
        obj.label, obj.confidence, obj.status, obj.reason = now.label, now.confidence, now.status, now.reason
        if unfit := self._unfit(obj, obj.label):
            obj.confidence *= self._config.false_positives.misfit_factor
            if obj.status == "confirmed":
                obj.status, obj.reason = "candidate", unfit
        if obj.evidence.flipped != flipped:
            self._log(obj, view, obj.label, obj.confidence, "flipped", obj.reason)
        elif obj.status != before and obj.status != "candidate":
            self._log(obj, view, obj.label, obj.confidence, obj.status, obj.reason)

    def _record_misses(self, view: PosedView, detections: tuple[DetectedObject, ...], seen: set[int]) -> None:
        """Negative evidence on the objects in plain view of a robot that no detection shows."""
        c, min_score = self._config.false_positives, self._config.points.min_score
        before = (self._objects[i] for i in self._objects.boxes.before(view.T_world_camera, c.miss_far_m + 1.0))
        objects = [o for o in before if o.id not in seen and o.status != "rejected"]
        shares, pixels = in_plain_view(view, [o.shape.samples for o in objects], c.miss_near_m, c.miss_far_m)
        for obj, share, pixel in zip(objects, shares, pixels, strict=True):
            if share < c.miss_visible or any(
                d.label == obj.label and d.score >= min_score and _holds(d, pixel) for d in detections
            ):
                continue
            obj.miss(view)
            self._log(obj, view, obj.label, 0.0, "not_seen", f"{share:.0%} of its points in plain view")
            self._reassess(obj, view)

    # --- sizes ----------------------------------------------------------------------------------------------------

    def _outgrows(self, label: str, shape: Shape, more: Shape) -> bool:
        """Whether a thing would be too large for its class with more points, and isn't yet: then they aren't its own."""
        if not self._config.false_positives.size_prior or outgrown(label, *self._extent(shape.p_min, shape.p_max)):
            return False
        low, high = np.minimum(shape.p_min, more.p_min), np.maximum(shape.p_max, more.p_max)
        return bool(outgrown(label, *self._extent(low, high)))

    def _extent(
        self, p_min: NDArray[np.float64], p_max: NDArray[np.float64]
    ) -> tuple[tuple[float, float, float], float]:
        """Size and top above the floor [m] of a box."""
        return _triple(p_max - p_min), float(p_max[2]) - self._floor_z_m

    def _unfit(self, obj: MapObject, label: str) -> str:
        if not self._config.false_positives.size_prior:
            return ""
        return misfit(label, *self._extent(obj.shape.p_min, obj.shape.p_max))

    # --- duplicates -----------------------------------------------------------------------------------------------

    def _merge_duplicates(self, view: PosedView) -> None:
        """Joins objects that turned out to be one. Looks only at those that changed: no spike as the map grows."""
        for obj in [o for _, o in sorted(self._objects.items()) if o.changed]:
            obj.changed = False
            if obj.id not in self._objects:
                continue
            for other in self._around(obj.shape):
                if other.id == obj.id or not self._are_one(obj, other):
                    continue
                kept, gone = (obj, other) if obj.id < other.id else (other, obj)
                self._absorb(kept, gone, view)
                if gone is obj:
                    break

    def _are_one(self, a: MapObject, b: MapObject) -> bool:
        """Whether two objects overlap both ways, or look alike and one lies in the other; no class is outgrown by it."""
        c = self._config.association
        there, back = overlaps(a.shape, b.shape)
        if not same_place(min(there, back), c):
            comparable = a.embedding_model == b.embedding_model
            alike = comparable and cosine(a.embedding_sum, b.embedding_sum) >= c.merge_visual
            together = max(there, back) >= c.merge_overlap or (
                c.merge_box is not None and box_overlap(a.shape, b.shape) >= c.merge_box
            )
            if not (alike and together):
                return False
        return not any(self._outgrows(x.label, x.shape, y.shape) for x, y in ((a, b), (b, a)))

    def _absorb(self, kept: MapObject, gone: MapObject, view: PosedView) -> None:
        kept.absorb(gone, self._config.max_voxels)
        self._objects[kept.id] = kept
        del self._objects[gone.id]
        note = f"object {gone.id} was the same thing"
        self._log(kept, view, gone.label, gone.confidence, "merged", note, absorbed=gone.id)
        self._reassess(kept, view)

    def _forget_weakest(self) -> None:
        while len(self._objects) > self._config.max_objects:
            of_worth = (
                ((o.status == "confirmed", o.confidence, o.last_seen_ns, i), i) for i, o in self._objects.items()
            )
            del self._objects[min(of_worth)[1]]

    # --- what others see ------------------------------------------------------------------------------------------

    def _log(
        self,
        obj: MapObject,
        view: PosedView,
        label: str,
        score: float,
        what: Change,
        note: str,
        box_px: tuple[float, float, float, float] | None = None,
        absorbed: int = 0,
    ) -> None:
        event = ObjectEvent(
            view.stamp_ns, view.source, view.view, view.seq, label, round(float(score), 4), what, note, box_px
        )
        obj.history.append(event)
        self._changes.append(ObjectChange(obj.id, event, absorbed))

    def ids(self) -> list[int]:
        """The ids of all objects, ascending."""
        return sorted(self._objects)

    def records(self, since: int = -1) -> list[ObjectRecord]:
        """The objects as messages, by id; only those that changed after revision ``since``.

        Records are cached: one is made again only after something happened to its object.
        """
        changed = [o for _, o in sorted(self._objects.items()) if o.revision > since]
        for o in changed:
            o.record = o.record or self._record(o)
        return [o.record for o in changed if o.record is not None]

    def relevances(self, text: NDArray[np.float32], embedding_model: str) -> dict[int, float | None]:
        """By id, how much each object sounds like a text (D,); None: its embedding comes from another model."""
        return {o.id: o.relevance(text, embedding_model) for o in self._objects.values()}

    def _record(self, o: MapObject) -> ObjectRecord:
        points, confidences = o.shape.points, self._confirmation.confidences(o.evidence)
        (label_robot, by_robot), (label_cameras, by_cameras) = confidences.best_robot, confidences.best_surveillance
        factor = self._config.false_positives.misfit_factor
        return ObjectRecord(
            id=o.id,
            floor=self._floor,
            label=o.label,
            status=o.status,
            confidence=o.confidence,
            confidence_robot=by_robot,
            confidence_surveillance=by_cameras,
            label_robot=label_robot,
            label_surveillance=label_cameras,
            n_detections=o.n_detections,
            n_points=len(points),
            center_m=_triple((o.shape.p_min + o.shape.p_max) / 2),
            size_m=_triple(o.shape.p_max - o.shape.p_min),
            first_seen_ns=o.first_seen_ns,
            last_seen_ns=o.last_seen_ns,
            sources=sorted(o.sources),
            reason=o.reason,
            points=points[evenly(len(points), _RECORD_POINTS)].astype(np.float32).tobytes(),
            history=list(o.history),
            label_scores={k: v * (factor if self._unfit(o, k) else 1.0) for k, v in confidences.by_class().items()},
            seen_from=(float(o.seen_from_sum[0]) / o.n_detections, float(o.seen_from_sum[1]) / o.n_detections),
        )


def _rank(found: Similarity, config: AssociationConfig) -> float:
    """Overlap both ways counts as much as looks and place together."""
    return max(found.s, config.tau + found.mutual if same_place(found.mutual, config) else -math.inf)


def _holds(detected: DetectedObject, pixel: NDArray[np.float64]) -> bool:
    x0, y0, x1, y1 = detected.box_px
    return bool(x0 <= pixel[0] <= x1 and y0 <= pixel[1] <= y1)


def _triple(v: NDArray[np.float64]) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])
