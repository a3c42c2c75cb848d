"""What the views from each direction showed of an object.

Views from one direction repeat each other, so the evidence on an object is counted per direction and only then combined
(``posterior``).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

#: Where an object was seen from: ("camera", the camera's source name), ("estimate", the same of a camera without a depth
#: sensor, which may have seen another object near by), or ("robot", the sector 0-7 of the compass).
Direction = tuple[str, str]

_MAX_DIRECTIONS = 32  # more than an object has sides, plus the cameras that may see it
#: Views may call one object by so many classes. That further ones are left out bounds what each detection of it costs.
MAX_CLASSES = 64
_MAX_CHANCE = 0.98  # no single detection is believed more than this


@dataclass(slots=True)
class ViewEvidence:
    """What all views from one direction showed of one object.

    Attributes:
        detections: number of detections by class.
        max_log_odds: log-odds of the surest detection by class.
        misses: number of views that had the object in plain sight without any detection of it.
    """

    detections: dict[str, int] = field(default_factory=dict)
    max_log_odds: dict[str, float] = field(default_factory=dict)
    misses: int = 0

    @property
    def n_detecting_views(self) -> int:
        """Roughly the number of views with a detection of the object. A view may detect it as two classes at once."""
        return max(self.detections.values(), default=0)

    def add_detections(self, label: str, max_log_odds: float, n: int = 1) -> None:
        """Adds ``n`` detections of a class, the surest of which has ``max_log_odds``; none of one class too many."""
        if label not in self.detections and len(self.detections) >= MAX_CLASSES:
            return
        self.detections[label] = self.detections.get(label, 0) + n
        self.max_log_odds[label] = max(max_log_odds, self.max_log_odds.get(label, -math.inf))


@dataclass(slots=True)
class EvidenceByDirection:
    """The view evidence on one object, by the direction of the views."""

    views: dict[Direction, ViewEvidence] = field(default_factory=dict)

    def __iter__(self) -> Iterator[tuple[Direction, ViewEvidence]]:
        return iter(sorted(self.views.items()))

    def __len__(self) -> int:
        return len(self.views)

    def of_sources(self, *kinds: str) -> Mapping[Direction, ViewEvidence]:
        """The evidence by the given kinds of sources ("robot", "camera", "estimate") only."""
        return {direction: evidence for direction, evidence in self if direction[0] in kinds}

    def add_detection(self, direction: Direction, label: str, chance: float) -> None:
        """Adds a detection of a class that is right with a probability of ``chance`` (0-1)."""
        if (evidence := self._at(direction)) is not None:
            evidence.add_detections(label, log_odds(chance))

    def add_miss(self, direction: Direction) -> None:
        if (evidence := self._at(direction)) is not None:
            evidence.misses += 1

    def absorb(self, other: EvidenceByDirection) -> None:
        """Adds the evidence on another object that turned out to be this one."""
        for direction, theirs in other:
            if (evidence := self._at(direction)) is not None:
                evidence.misses += theirs.misses
                for label, n in theirs.detections.items():
                    evidence.add_detections(label, theirs.max_log_odds[label], n)

    def move(self, old: Direction, new: Direction) -> None:
        """Counts what was seen from one direction as seen from another."""
        moved = EvidenceByDirection({new: self.views.pop(old)} if old in self.views else {})
        self.absorb(moved)

    def _at(self, direction: Direction) -> ViewEvidence | None:
        """The evidence from a direction, created if needed; None once there are so many that another adds nothing."""
        if direction not in self.views and len(self.views) >= _MAX_DIRECTIONS:
            return None
        return self.views.setdefault(direction, ViewEvidence())

    def state(self) -> list[Any]:
        """Everything as plain values, for ``from_state``."""
        return [[*direction, dict(e.detections), dict(e.max_log_odds), e.misses] for direction, e in self]

    @classmethod
    def from_state(cls, rows: list[Any]) -> EvidenceByDirection:
        return cls({(str(kind), str(name)): ViewEvidence(*fields) for kind, name, *fields in rows})


def log_odds(chance: float) -> float:
    """``log(p / (1 - p))`` of a probability, which is first limited to 0.02-0.98."""
    p = min(_MAX_CHANCE, max(1.0 - _MAX_CHANCE, chance))
    return math.log(p / (1.0 - p))
