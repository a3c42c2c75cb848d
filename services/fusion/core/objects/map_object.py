"""One object of the joint map: its detections fused into one shape, embedding and body of evidence."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.messages.maps import ObjectEvent, ObjectRecord
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core.objects.assessment import Status
from surveilnav.services.fusion.core.objects.association import cosine
from surveilnav.services.fusion.core.objects.config import ObjectConfig
from surveilnav.services.fusion.core.objects.evidence import Evidence
from surveilnav.services.fusion.core.objects.localization import LocatedDetection
from surveilnav.services.fusion.core.objects.shape import Shape
from surveilnav.services.fusion.core.objects.sighting_box import SightingBox
from surveilnav.services.fusion.core.objects.view_evidence import Direction

Change = Literal["created", "matched", "merged", "confirmed", "rejected", "flipped", "not_seen"]
#: Attributes that are plain values or arrays and go into ``state`` as they are.
#: Of more views of cameras without a depth sensor, the newest are kept.
_MAX_ESTIMATED = 16
_STATE = (
    "id",
    "embedding_sum",
    "seen_from_sum",
    "first_seen_ns",
    "last_seen_ns",
    "label",
    "confidence",
    "status",
    "reason",
    "n_detections",
    "merge_pending",
    "embedding_model",
    "covariance_m2",
)


@dataclass(frozen=True, slots=True)
class ObjectChange:
    """An event of an object. ``absorbed``: id of the object that was merged into it, 0 if none was."""

    object_id: int
    event: ObjectEvent
    absorbed: int = 0


@dataclass(slots=True, eq=False)
class MapObject:
    """One object.

    Attributes:
        embedding_sum: sum of its detections' unit embeddings (D,). Its direction is that of their mean.
        embedding_model: the model of those embeddings, which is that of the newest detection. Embeddings of other models
            are left out.
        seen_from_sum: sum of the horizontal unit vectors (2,) from the object towards the cameras of its detections.
        covariance_m2: (2, 2) of its horizontal position as long as that is only estimated; None once a sensor has measured it.
        estimated: where cameras without a depth sensor saw something that may be this object, the oldest first.
        merge_pending: whether the object has changed since duplicates were last searched for.
        record: the object as a message, cached until something happens to it.
        revision: revision of the joint map at which something last happened to it.
    """

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
    merge_pending: bool = True
    embedding_model: str = ""
    covariance_m2: NDArray[np.float64] | None = None
    estimated: list[SightingBox] = field(default_factory=list)
    record: ObjectRecord | None = None
    revision: int = 0

    @classmethod
    def from_detection(cls, id_: int, view: PosedView, located: LocatedDetection, max_history: int) -> MapObject:
        """A new object with the shape of its first detection, which is yet to be fused into it."""
        detection = located.detection
        return cls(
            id=id_,
            shape=located.shape,
            label=detection.label,
            embedding_sum=np.zeros_like(detection.embedding),
            seen_from_sum=np.zeros(2),
            first_seen_ns=view.stamp_ns,
            last_seen_ns=view.stamp_ns,
            history=deque(maxlen=max_history),
            embedding_model=located.embedding_model,
            covariance_m2=located.covariance_m2,
        )

    @property
    def sigma_m(self) -> float:
        """Standard deviation of its position along the least certain direction; 0 if a sensor has measured it."""
        return 0.0 if self.covariance_m2 is None else math.sqrt(float(np.linalg.eigvalsh(self.covariance_m2)[-1]))

    def fuse(self, view: PosedView, located: LocatedDetection, max_voxels: int) -> None:
        """Adds a detection: its points, its embedding and its evidence (the paper's joint object fusion)."""
        detection = located.detection
        self._place(located.shape, located.covariance_m2, view.source not in self.sources, max_voxels)
        if self._comparable(located.embedding_model, detection.embedding):
            self.embedding_sum = self.embedding_sum + detection.embedding
        else:
            self.embedding_sum, self.embedding_model = detection.embedding, located.embedding_model
        self.seen_from_sum = self.seen_from_sum + _towards_camera(view, located.shape)
        self.first_seen_ns = min(self.first_seen_ns, view.stamp_ns)
        self.last_seen_ns = max(self.last_seen_ns, view.stamp_ns)
        self.n_detections += 1
        self.sources.add(view.source)
        self.merge_pending = True
        self.evidence.add_detection(
            detection.label, detection.score, detection.confidence, _direction_of(view, located.shape)
        )
        if located.covariance_m2 is not None:
            self.estimated = [*self.estimated, SightingBox.from_detection(view, detection)][-_MAX_ESTIMATED:]

    def verify_estimated(self) -> None:
        """Once a sensor has measured the object: a camera without one whose picture shows the object just there saw this object.

        What it saw then counts as that of a camera with a depth sensor.
        """
        if self.covariance_m2 is not None or not self.estimated:
            return
        shown = {sighting.source for sighting in self.estimated if sighting.shows(self.shape.samples)}
        self.estimated = [sighting for sighting in self.estimated if sighting.source not in shown]
        for source in sorted(shown):
            self.evidence.by_direction.move(("estimate", source), ("camera", source))

    def add_miss(self, view: PosedView) -> None:
        """Adds a robot's view that had the object in plain sight without a detection of it."""
        self.evidence.add_miss(_direction_of(view, self.shape))

    def absorb(self, other: MapObject, max_voxels: int) -> None:
        """Adds everything known of another object, which turned out to be the same thing."""
        self._place(other.shape, other.covariance_m2, not other.sources <= self.sources, max_voxels)
        if self._comparable(other.embedding_model, other.embedding_sum):
            self.embedding_sum = self.embedding_sum + other.embedding_sum
        self.seen_from_sum = self.seen_from_sum + other.seen_from_sum
        self.first_seen_ns = min(self.first_seen_ns, other.first_seen_ns)
        self.last_seen_ns = max(self.last_seen_ns, other.last_seen_ns)
        self.n_detections += other.n_detections
        self.sources |= other.sources
        self.evidence.absorb(other.evidence)
        self.estimated = [*self.estimated, *other.estimated][-_MAX_ESTIMATED:]
        events = sorted([*self.history, *other.history], key=lambda e: e.stamp_ns)
        self.history = deque(events, maxlen=self.history.maxlen)

    def _place(
        self, shape: Shape, covariance_m2: NDArray[np.float64] | None, independent: bool, max_voxels: int
    ) -> None:
        """Adds the place of a detection or of another object. What a sensor measured replaces estimates, and none changes it.

        Two independent estimates give their mean, weighted by their certainty. Of two by one camera, whose errors are the
        same, the more certain one counts.
        """
        mine = self.covariance_m2
        if covariance_m2 is None and mine is None:
            self.shape = self.shape.union(shape, max_voxels)
        elif covariance_m2 is None:
            self.shape, self.covariance_m2 = shape, None
        elif mine is None or shape is self.shape:
            return
        elif not independent:
            if np.trace(covariance_m2) < np.trace(mine):
                self.shape, self.covariance_m2 = shape, covariance_m2
        else:
            gain = mine @ np.linalg.inv(mine + covariance_m2)
            mean_m = self.shape.centre_m[:2] + gain @ (shape.centre_m - self.shape.centre_m)[:2]
            better = self.shape if np.trace(mine) <= np.trace(covariance_m2) else shape
            self.shape = better.moved(mean_m - better.centre_m[:2])
            self.covariance_m2 = mine - gain @ mine

    def _comparable(self, embedding_model: str, embedding: NDArray[np.float32]) -> bool:
        return embedding_model == self.embedding_model and embedding.shape == self.embedding_sum.shape

    def relevance(self, text: NDArray[np.float32], embedding_model: str) -> float | None:
        """Cosine of the detections' mean embedding and a text embedding (D,); None if their models differ."""
        return cosine(self.embedding_sum, text) if self._comparable(embedding_model, text) else None

    def state(self) -> dict[str, Any]:
        """Everything as plain arrays and values, for ``from_state``."""
        return {
            "keys": self.shape.keys,
            "evidence": self.evidence.state(),
            "sources": sorted(self.sources),
            "history": list(self.history),
            "estimated": [sighting.state() for sighting in self.estimated],
            **{name: getattr(self, name) for name in _STATE},
        }

    @classmethod
    def from_state(cls, state: dict[str, Any], voxel_m: float, config: ObjectConfig) -> MapObject:
        history = deque(msgspec.convert(state["history"], list[ObjectEvent]), maxlen=config.max_history)
        return cls(
            shape=Shape(state["keys"], voxel_m, config.association.overlap_voxel_m),
            evidence=Evidence.from_state(state["evidence"]),
            sources=set(state["sources"]),
            history=history,
            estimated=[SightingBox.from_state(row) for row in state["estimated"]],
            **{name: state[name] for name in _STATE},
        )


def _direction_of(view: PosedView, shape: Shape) -> Direction:
    """Where a view sees an object from: which camera, or which of the eight sectors around the object a robot is in."""
    if not view.is_robot:
        return "camera" if view.depth_source == "sensor" else "estimate", view.source
    x, y = _towards_camera(view, shape)
    return "robot", str(int((math.atan2(y, x) / math.pi + 1.0) * 4.0) % 8)


def _towards_camera(view: PosedView, shape: Shape) -> NDArray[np.float64]:
    """Horizontal unit vector (2,) from the centre of a shape to the view's camera; zero right above or below it."""
    offset_m: NDArray[np.float64] = view.T_world_camera[:2, 3] - (shape.p_min + shape.p_max)[:2] / 2
    length_m = float(np.linalg.norm(offset_m))
    return offset_m / length_m if length_m > 1e-6 else np.zeros(2)
