"""One object of the joint map, and what changes it."""

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
from surveilnav.services.fusion.core.config import ObjectConfig
from surveilnav.services.fusion.core.objects.assessment import Status
from surveilnav.services.fusion.core.objects.association import cosine
from surveilnav.services.fusion.core.objects.evidence import Evidence
from surveilnav.services.fusion.core.objects.localization import Sighting
from surveilnav.services.fusion.core.objects.shape import Shape
from surveilnav.services.fusion.core.objects.view_evidence import Direction

Change = Literal["created", "matched", "merged", "confirmed", "rejected", "flipped", "not_seen"]
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
    "changed",
    "embedding_model",
)


@dataclass(frozen=True, slots=True)
class ObjectChange:
    """What happened to an object; ``absorbed``: the object that was found to be the same, 0 for none."""

    object_id: int
    event: ObjectEvent
    absorbed: int = 0


@dataclass(slots=True, eq=False)
class MapObject:
    """One object.

    Attributes:
        embedding_sum: of its detections' unit embeddings (D,): in direction their mean, weighted by counts.
        embedding_model: whose embeddings those are: the newest detection's model. Others' are left out.
        seen_from_sum: of the horizontal unit vectors (2,) from each detection to who made it.
        changed: since duplicates were last searched for.
        record: as others see it, until something happens to it.
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
    changed: bool = True
    embedding_model: str = ""
    record: ObjectRecord | None = None
    revision: int = 0

    @classmethod
    def of_sighting(cls, id_: int, view: PosedView, sighting: Sighting, max_history: int) -> MapObject:
        """A new object, before its first sighting is fused into it."""
        detected = sighting.detected
        return cls(
            id=id_,
            shape=sighting.shape,
            label=detected.label,
            embedding_sum=np.zeros_like(detected.embedding),
            seen_from_sum=np.zeros(2),
            first_seen_ns=view.stamp_ns,
            last_seen_ns=view.stamp_ns,
            history=deque(maxlen=max_history),
            embedding_model=sighting.embedding_model,
        )

    def fuse(self, view: PosedView, sighting: Sighting, max_voxels: int) -> None:
        """Adds a detection: its points, its embedding, its evidence (the paper's joint object fusion)."""
        detected = sighting.detected
        self.shape = self.shape.union(sighting.shape, max_voxels)
        if self._comparable(sighting.embedding_model, detected.embedding):
            self.embedding_sum = self.embedding_sum + detected.embedding
        else:
            self.embedding_sum, self.embedding_model = detected.embedding, sighting.embedding_model
        self.seen_from_sum = self.seen_from_sum + _towards(view, sighting.shape)
        self.first_seen_ns = min(self.first_seen_ns, view.stamp_ns)
        self.last_seen_ns = max(self.last_seen_ns, view.stamp_ns)
        self.n_detections += 1
        self.sources.add(view.source)
        self.changed = True
        self.evidence.add(detected.label, detected.score, detected.confidence, _direction(view, sighting.shape))

    def miss(self, view: PosedView) -> None:
        """A robot had it in plain sight, and no detection shows it."""
        self.evidence.miss(_direction(view, self.shape))

    def absorb(self, other: MapObject, max_voxels: int) -> None:
        """Adds all that was known of another object, which is the same thing."""
        self.shape = self.shape.union(other.shape, max_voxels)
        if self._comparable(other.embedding_model, other.embedding_sum):
            self.embedding_sum = self.embedding_sum + other.embedding_sum
        self.seen_from_sum = self.seen_from_sum + other.seen_from_sum
        self.first_seen_ns = min(self.first_seen_ns, other.first_seen_ns)
        self.last_seen_ns = max(self.last_seen_ns, other.last_seen_ns)
        self.n_detections += other.n_detections
        self.sources |= other.sources
        self.evidence.absorb(other.evidence)
        events = sorted([*self.history, *other.history], key=lambda e: e.stamp_ns)
        self.history = deque(events, maxlen=self.history.maxlen)

    def _comparable(self, embedding_model: str, embedding: NDArray[np.float32]) -> bool:
        return embedding_model == self.embedding_model and embedding.shape == self.embedding_sum.shape

    def relevance(self, text: NDArray[np.float32], embedding_model: str) -> float | None:
        """Cosine of its detections' mean embedding and a text's (D,); None if they come from different models."""
        return cosine(self.embedding_sum, text) if self._comparable(embedding_model, text) else None

    def state(self) -> dict[str, Any]:
        """All of it, as plain arrays and values, for ``from_state``."""
        return {
            "keys": self.shape.keys,
            "evidence": self.evidence.state(),
            "sources": sorted(self.sources),
            "history": list(self.history),
            **{name: getattr(self, name) for name in _STATE},
        }

    @classmethod
    def from_state(cls, state: dict[str, Any], voxel_m: float, config: ObjectConfig) -> MapObject:
        """The object that ``state`` describes."""
        history = deque(msgspec.convert(state["history"], list[ObjectEvent]), maxlen=config.max_history)
        return cls(
            shape=Shape(state["keys"], voxel_m, config.association.overlap_voxel_m),
            evidence=Evidence.from_state(state["evidence"]),
            sources=set(state["sources"]),
            history=history,
            **{name: state[name] for name in _STATE if name in state},  # older states name no model
        )


def _direction(view: PosedView, shape: Shape) -> Direction:
    """From where a view shows a thing: a camera by its name, a robot by an eighth of the compass around the thing."""
    if not view.is_robot:
        return "camera", view.source
    x, y = _towards(view, shape)
    return "robot", str(int((math.atan2(y, x) / math.pi + 1.0) * 4.0) % 8)


def _towards(view: PosedView, shape: Shape) -> NDArray[np.float64]:
    """The horizontal unit vector (2,) from a detection's middle to its camera; nothing right above or below."""
    way: NDArray[np.float64] = view.T_world_camera[:2, 3] - (shape.p_min + shape.p_max)[:2] / 2
    length_m = float(np.linalg.norm(way))
    return way / length_m if length_m > 1e-6 else np.zeros(2)
