"""The joint object map of a floor.

The paper's section "Joint 3D Object Map and Target Confirmation": detections are located in the world (``localization``),
associated with objects (``association``, eq. 3) and fused into them (``map_object``); then objects are confirmed
(``confirmation``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.messages.maps import ObjectEvent, ObjectRecord
from surveilnav.sensing.views import DetectedObject, PosedView
from surveilnav.services.fusion.core.objects.association import (
    Similarity,
    box_overlap,
    cosine,
    gate_distance,
    is_same_place,
    overlaps,
    similarity,
)
from surveilnav.services.fusion.core.objects.config import AssociationConfig, ObjectConfig
from surveilnav.services.fusion.core.objects.confirmation import confirmation_rule
from surveilnav.services.fusion.core.objects.indexed_objects import IndexedObjects
from surveilnav.services.fusion.core.objects.localization import LocatedDetection, locate_all
from surveilnav.services.fusion.core.objects.map_object import Change, MapObject, ObjectChange
from surveilnav.services.fusion.core.objects.shape import Shape, spread_indices
from surveilnav.services.fusion.core.objects.sizes import size_mismatch, too_large
from surveilnav.services.fusion.core.objects.visibility import visible_shares

_MAX_RECORD_POINTS = 256  # of an object, in its message


class ObjectMap:
    """All objects of a floor."""

    def __init__(self, floor: str, floor_z_m: float, voxel_m: float, config: ObjectConfig) -> None:
        self._floor = floor
        self._floor_z_m = floor_z_m
        self._voxel_m = voxel_m
        self._config = config
        self._confirmation = confirmation_rule(config)
        self._objects = IndexedObjects()
        self._next_id = 1
        self._views = 0
        self._changes: list[ObjectChange] = []

    def __len__(self) -> int:
        return len(self._objects)

    def add_detections(self, view: PosedView, detections: tuple[DetectedObject, ...], embedding_model: str = "") -> int:
        """Adds what a detector found in a view.

        A robot's view is evidence by what it doesn't show, too: against objects in plain sight without a detection.

        Returns:
            The number of detections that could be located.
        """
        # masks -> points in the world
        located = locate_all(view, detections, self._floor_z_m, self._voxel_m, self._config, embedding_model)
        self.add_located(view, detections, located)
        return len(located)

    def add_located(
        self, view: PosedView, detections: tuple[DetectedObject, ...], located: Sequence[LocatedDetection]
    ) -> None:
        """``add_detections`` with the detections already located, the strongest first."""
        # eq. 3: each detection joins the most similar object or starts a new one
        seen: set[tuple[int, str]] = set()
        for detection in located:
            self._associate(view, detection, seen)
        # negative evidence: what should have been seen and wasn't
        if view.is_robot:
            self._record_misses(view, detections, {object_id for object_id, _ in seen})
        # objects that turned out to be one
        self._views += 1
        every = self._config.association.merge_every
        if every is not None and self._views % every == 0:
            self._merge_duplicates(view)
        self._remove_weakest()

    def size_mismatch(self, object_id: int, label: str) -> str:
        """Why an object can't be of a class by its size, in words for people; empty if it can. KeyError: no such object."""
        return self._size_mismatch(self._objects[object_id], label)

    def pop_changes(self, revision: int) -> list[ObjectChange]:
        """Returns the events of objects since the last call, and stamps these objects as changed at ``revision``."""
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
        objects = cls(floor, floor_z_m, voxel_m, config)
        objects._next_id, objects._views = state["next_id"], state["views"]
        for of_object in state["objects"]:
            objects._objects[of_object["id"]] = MapObject.from_state(of_object, voxel_m, config)
        return objects

    # --- association ----------------------------------------------------------------------------------------------

    def _associate(self, view: PosedView, located: LocatedDetection, seen: set[tuple[int, str]]) -> None:
        """Fuses a detection into the object that it belongs to, or into a new one.

        Args:
            seen: the (object id, class) of the view's detections so far; this one is added.
        """
        c, label = self._config.association, located.detection.label
        for found, obj in self._matches(located, seen):
            if c.once_per_view and (obj.id, label) in seen:
                if found.mutual_overlap >= (1.0 if c.tau_mutual is None else c.tau_mutual):
                    return  # the same thing was detected twice in one picture
                continue
            self._fuse(obj, view, located, "matched", f"s = {found.s:.2f}")
            seen.add((obj.id, label))
            return
        new = MapObject.from_detection(self._next_id, view, located, self._config.max_history)
        self._next_id += 1
        self._fuse(new, view, located, "created", "")
        seen.add((new.id, label))

    def _matches(self, located: LocatedDetection, seen: set[tuple[int, str]]) -> list[tuple[Similarity, MapObject]]:
        """The objects that a detection may belong to, the most similar first: s reaches tau, or both are in one place."""
        c, shape, detection = self._config.association, located.shape, located.detection
        matches = []
        for obj in self._match_candidates(shape):
            if located.covariance_m2 is not None or obj.covariance_m2 is not None:
                continue
            comparable = located.embedding_model == obj.embedding_model
            found = similarity(shape, detection.embedding, obj.shape, obj.embedding_sum, c, comparable=comparable)
            same_place = is_same_place(found.mutual_overlap, c)
            if found.s < c.tau and not same_place:
                continue
            if self._would_be_too_large(obj.label, obj.shape, shape):
                continue
            if not same_place and self._would_be_too_large(detection.label, shape, obj.shape):
                continue  # a tv on a cupboard is no part of the cupboard
            matches.append((found, obj))
        matches += self._matches_by_gate(located, seen)
        return sorted(matches, key=lambda match: (-_match_score(match[0], c), match[1].id))

    def _matches_by_gate(
        self, located: LocatedDetection, seen: set[tuple[int, str]]
    ) -> list[tuple[Similarity, MapObject]]:
        """The objects that a detection may belong to where a place is only estimated: of the same class, and near enough.

        What its view has shown already, and all after one in the same place, is left out: it couldn't be chosen, and for hundreds
        of detections in one place the effort would grow with their square.
        """
        c, matches = self._config.foot_point, []
        if located.covariance_m2 is None and not self._objects.estimated:
            return []
        once_per_view, label = self._config.association.once_per_view, located.detection.label
        reach_m = c.gate * (c.max_sigma_m + (0.0 if located.covariance_m2 is None else c.max_sigma_m))
        for obj_id in self._objects.boxes.near(located.shape, reach_m):
            obj = self._objects[obj_id]
            if (located.covariance_m2 is None and obj.covariance_m2 is None) or obj.label != label:
                continue
            if once_per_view and (obj_id, label) in seen:
                continue
            distance = gate_distance(located.shape, located.covariance_m2, obj.shape, obj.covariance_m2)
            if distance <= c.gate:
                # the nearer, the more similar; always enough
                matches.append((Similarity(self._config.association.tau + 1.0 - distance / c.gate, 0.0), obj))
            if not distance:
                break
        return matches

    def _match_candidates(self, shape: Shape) -> list[MapObject]:
        """The objects that may be similar enough: those near by, unless looks alone can reach tau."""
        c = self._config.association
        if c.w_visual >= c.tau:
            return [o for _, o in sorted(self._objects.items())]
        return [self._objects[i] for i in self._objects.boxes.near(shape, 2 * c.overlap_voxel_m)]

    # --- fusion and confirmation ----------------------------------------------------------------------------------

    def _fuse(self, obj: MapObject, view: PosedView, located: LocatedDetection, what: Change, note: str) -> None:
        detection = located.detection
        obj.fuse(view, located, self._config.max_voxels)
        self._objects[obj.id] = obj
        self._record_event(obj, view, detection.label, detection.score, what, note, detection.box_px)
        self._reassess(obj, view)

    def _reassess(self, obj: MapObject, view: PosedView) -> None:
        """Applies the rule of confirmation, and the size prior, to an object whose evidence or shape has changed."""
        obj.record = None
        obj.verify_estimated()
        former_status, former_flip = obj.status, obj.evidence.flipped
        self._confirmation.update(obj.evidence)
        result = self._confirmation.assess(obj.evidence, former_status)
        obj.label, obj.confidence, obj.status, obj.reason = (
            result.label,
            result.confidence,
            result.status,
            result.reason,
        )
        if obj.status == "confirmed" and obj.sigma_m > self._config.foot_point.confirm_max_sigma_m:
            obj.status, obj.reason = "candidate", f"its place is only known to {obj.sigma_m:.2f} m (standard deviation)"
        if mismatch := self._size_mismatch(obj, obj.label):
            obj.confidence *= self._config.false_positives.size_mismatch_factor
            if obj.status == "confirmed":
                obj.status, obj.reason = "candidate", mismatch
        if obj.evidence.flipped != former_flip:
            self._record_event(obj, view, obj.label, obj.confidence, "flipped", obj.reason)
        elif obj.status != former_status and obj.status != "candidate":
            self._record_event(obj, view, obj.label, obj.confidence, obj.status, obj.reason)

    def _record_misses(self, view: PosedView, detections: tuple[DetectedObject, ...], seen: set[int]) -> None:
        """Adds negative evidence to the objects that a robot has in plain sight without a detection of them."""
        c, min_score = self._config.false_positives, self._config.points.min_score
        ahead = self._objects.boxes.in_front_of(view.T_world_camera, c.miss_max_range_m + 1.0)
        objects = [o for o in (self._objects[i] for i in ahead) if o.id not in seen and self._can_be_missed(o)]
        points = [o.shape.samples for o in objects]
        shares, pixels = visible_shares(view, points, c.miss_min_range_m, c.miss_max_range_m)
        for obj, share, pixel in zip(objects, shares, pixels, strict=True):
            if share < c.miss_min_visible or any(
                d.label == obj.label and d.score >= min_score and _box_contains(d, pixel) for d in detections
            ):
                continue
            obj.add_miss(view)
            self._record_event(obj, view, obj.label, 0.0, "not_seen", f"{share:.0%} of its points in plain view")
            self._reassess(obj, view)

    def _can_be_missed(self, obj: MapObject) -> bool:
        """Whether a view of where an object should be says something about it."""
        return obj.status != "rejected" and obj.sigma_m <= self._config.foot_point.miss_max_sigma_m

    # --- sizes ----------------------------------------------------------------------------------------------------

    def _would_be_too_large(self, label: str, shape: Shape, added: Shape) -> bool:
        """Whether a thing isn't too large for its class now but would be with the points of another shape.

        Those points then belong to something else.
        """
        if not self._config.false_positives.size_prior or too_large(label, *self._size(shape.p_min, shape.p_max)):
            return False
        p_min, p_max = np.minimum(shape.p_min, added.p_min), np.maximum(shape.p_max, added.p_max)
        return bool(too_large(label, *self._size(p_min, p_max)))

    def _size(self, p_min: NDArray[np.float64], p_max: NDArray[np.float64]) -> tuple[tuple[float, float, float], float]:
        """The extents of a box, and the height of its top above the floor [m]."""
        return _xyz(p_max - p_min), float(p_max[2]) - self._floor_z_m

    def _size_mismatch(self, obj: MapObject, label: str) -> str:
        if not self._config.false_positives.size_prior:
            return ""
        return size_mismatch(label, *self._size(obj.shape.p_min, obj.shape.p_max))

    # --- duplicates -----------------------------------------------------------------------------------------------

    def _merge_duplicates(self, view: PosedView) -> None:
        """Merges objects that turned out to be one. Only those that changed are checked, whatever the size of the map."""
        for obj in [o for _, o in sorted(self._objects.items()) if o.merge_pending]:
            obj.merge_pending = False
            if obj.id not in self._objects:
                continue
            for other in self._match_candidates(obj.shape):
                if other.id == obj.id or not self._are_duplicates(obj, other):
                    continue
                kept, absorbed = (obj, other) if obj.id < other.id else (other, obj)
                self._absorb(kept, absorbed, view)
                if absorbed is obj:
                    break

    def _are_duplicates(self, a: MapObject, b: MapObject) -> bool:
        """Whether two objects are one: both are in one place, or they look alike and one lies within the other.

        Neither may become too large for its class by that.
        """
        c = self._config.association
        if a.covariance_m2 is not None or b.covariance_m2 is not None:
            if a.label != b.label:
                return False
            distance = gate_distance(a.shape, a.covariance_m2, b.shape, b.covariance_m2)
            return distance <= 0.5 * self._config.foot_point.gate
        forward, backward = overlaps(a.shape, b.shape)
        if not is_same_place(min(forward, backward), c):
            comparable = a.embedding_model == b.embedding_model
            look_alike = comparable and cosine(a.embedding_sum, b.embedding_sum) >= c.merge_visual
            one_within_other = max(forward, backward) >= c.merge_overlap or (
                c.merge_box is not None and box_overlap(a.shape, b.shape) >= c.merge_box
            )
            if not (look_alike and one_within_other):
                return False
        return not any(self._would_be_too_large(x.label, x.shape, y.shape) for x, y in ((a, b), (b, a)))

    def _absorb(self, kept: MapObject, absorbed: MapObject, view: PosedView) -> None:
        kept.absorb(absorbed, self._config.max_voxels)
        self._objects[kept.id] = kept
        del self._objects[absorbed.id]
        note = f"object {absorbed.id} was the same thing"
        self._record_event(kept, view, absorbed.label, absorbed.confidence, "merged", note, absorbed=absorbed.id)
        self._reassess(kept, view)

    def _remove_weakest(self) -> None:
        """Removes the weakest candidates while there are more objects than ``max_objects``."""
        n_too_many = len(self._objects) - self._config.max_objects
        if n_too_many > 0:
            strengths = ((o.status == "confirmed", o.confidence, o.last_seen_ns, i) for i, o in self._objects.items())
            for *_, id_ in sorted(strengths)[:n_too_many]:
                del self._objects[id_]

    # --- events and messages --------------------------------------------------------------------------------------

    def _record_event(
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
        """The objects as messages, by ascending id; only those that changed after revision ``since``.

        Messages are cached until something happens to their object.
        """
        changed = [o for _, o in sorted(self._objects.items()) if o.revision > since]
        for o in changed:
            o.record = o.record or self._record(o)
        return [o.record for o in changed if o.record is not None]

    def relevances(self, text: NDArray[np.float32], embedding_model: str) -> dict[int, float | None]:
        """Cosine of each object's embedding and a text embedding (D,), by id; None if their models differ."""
        return {o.id: o.relevance(text, embedding_model) for o in self._objects.values()}

    def _record(self, o: MapObject) -> ObjectRecord:
        points, confidences = o.shape.points, self._confirmation.confidences(o.evidence)
        (label_robot, by_robot), (label_cameras, by_cameras) = confidences.best_robot, confidences.best_surveillance
        factor = self._config.false_positives.size_mismatch_factor
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
            center_m=_xyz((o.shape.p_min + o.shape.p_max) / 2),
            size_m=_xyz(o.shape.p_max - o.shape.p_min),
            first_seen_ns=o.first_seen_ns,
            last_seen_ns=o.last_seen_ns,
            sources=sorted(o.sources),
            reason=o.reason,
            points=points[spread_indices(len(points), _MAX_RECORD_POINTS)].astype(np.float32).tobytes(),
            history=list(o.history),
            label_scores={
                k: v * (factor if self._size_mismatch(o, k) else 1.0) for k, v in confidences.by_class().items()
            },
            position_sigma_m=round(o.sigma_m, 3),
            seen_from=(float(o.seen_from_sum[0]) / o.n_detections, float(o.seen_from_sum[1]) / o.n_detections),
        )


def _match_score(found: Similarity, config: AssociationConfig) -> float:
    """s, or, for two things in one place, at least tau and their mutual overlap: place alone counts as much as eq. 3."""
    in_place = config.tau + found.mutual_overlap if is_same_place(found.mutual_overlap, config) else -math.inf
    return max(found.s, in_place)


def _box_contains(detection: DetectedObject, pixel: NDArray[np.float64]) -> bool:
    x0, y0, x1, y1 = detection.box_px
    return bool(x0 <= pixel[0] <= x1 and y0 <= pixel[1] <= y1)


def _xyz(v: NDArray[np.float64]) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])
