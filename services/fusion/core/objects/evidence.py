"""Everything that speaks for and against an object being of some class."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from surveilnav.services.fusion.core.objects.view_evidence import MAX_CLASSES, Direction, EvidenceByDirection


@dataclass(slots=True)
class ScoreSum:
    """The detections of one class by one kind of source: how many, and the sum of their scores."""

    n: int = 0
    total: float = 0.0

    def add(self, score: float, n: int = 1) -> None:
        """Adds ``n`` detections whose scores sum up to ``score``."""
        self.n += n
        self.total += score


@dataclass(slots=True)
class Evidence:
    """The evidence on one object.

    Attributes:
        robot: scores of robots' detections, by class.
        surveillance: scores of surveillance cameras' detections, by class.
        by_direction: what the views from each direction showed.
        misses: number of close robot views that should have shown the object but have no detection of it.
        category: the class that the paper's rule has decided on; empty before it has.
        flipped: the last change of ``category``, as (from, to).
    """

    robot: dict[str, ScoreSum] = field(default_factory=dict)
    surveillance: dict[str, ScoreSum] = field(default_factory=dict)
    by_direction: EvidenceByDirection = field(default_factory=EvidenceByDirection)
    misses: int = 0
    category: str = ""
    flipped: tuple[str, str] | None = None

    def add_detection(self, label: str, score: float, chance: float, direction: Direction) -> None:
        """Adds a detection of a class; ``chance`` (0-1) is the probability that it is right."""
        sums = self.robot if direction[0] == "robot" else self.surveillance
        _add(sums, label, score)
        self.by_direction.add_detection(direction, label, chance)

    def add_miss(self, direction: Direction) -> None:
        """Adds a robot's view that had the object in plain sight without a detection of it."""
        self.misses += 1
        self.by_direction.add_miss(direction)

    def flip(self, label: str) -> None:
        """Changes the category, which marks the object as a false positive for the paper's rule."""
        self.flipped = self.category, label
        self.category = label

    def count(self, label: str) -> int:
        """The number of detections of a class by all sources."""
        return sum(sums[label].n for sums in (self.robot, self.surveillance) if label in sums)

    def absorb(self, other: Evidence) -> None:
        """Adds the evidence on another object that turned out to be this one."""
        for mine, theirs in ((self.robot, other.robot), (self.surveillance, other.surveillance)):
            for label, scores in theirs.items():
                _add(mine, label, scores.total, scores.n)
        self.by_direction.absorb(other.by_direction)
        self.misses += other.misses
        self.category = self.category or other.category
        self.flipped = self.flipped or other.flipped

    def state(self) -> dict[str, Any]:
        """Everything as plain values, for ``from_state``."""
        return {
            "robot": {label: [s.n, s.total] for label, s in self.robot.items()},
            "surveillance": {label: [s.n, s.total] for label, s in self.surveillance.items()},
            "by_direction": self.by_direction.state(),
            "misses": self.misses,
            "category": self.category,
            "flipped": self.flipped,
        }

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> Evidence:
        robot, surveillance = (
            {label: ScoreSum(*fields) for label, fields in state[kind].items()} for kind in ("robot", "surveillance")
        )
        flipped = None
        if state["flipped"] is not None:
            old, new = state["flipped"]
            flipped = old, new
        by_direction = EvidenceByDirection.from_state(state["by_direction"])
        return cls(robot, surveillance, by_direction, state["misses"], state["category"], flipped)


def _add(sums: dict[str, ScoreSum], label: str, score: float, n: int = 1) -> None:
    """Adds detections to those of their class, unless it would be one class too many."""
    if label in sums or len(sums) < MAX_CLASSES:
        sums.setdefault(label, ScoreSum()).add(score, n)
