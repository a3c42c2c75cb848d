"""What speaks for and against an object: detections by class and source, and looks that should have shown it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

_MAX_PLACES = 16  # more different viewpoints than any rule asks for


@dataclass(slots=True)
class Support:
    """What one kind of source (robots, or surveillance) says for one class of one object."""

    n: int = 0
    near: int = 0
    weight: float = 0.0
    weighted_score: float = 0.0
    places: set[tuple[object, ...]] = field(default_factory=set)
    log_odds: dict[tuple[object, ...], float] = field(default_factory=dict)

    def add(
        self, score: float, weight: float, near: bool, place: tuple[object, ...], chance: float | None = None
    ) -> None:
        """One detection; ``place``: where it was seen from, to the metre or so. Views from one place see the same: of their
        chances the highest counts."""
        odds = log_odds(score if chance is None else chance)
        if place in self.log_odds or len(self.log_odds) < _MAX_PLACES:
            self.log_odds[place] = max(odds, self.log_odds.get(place, -math.inf))
        self.n += 1
        self.near += near
        self.weight += weight
        self.weighted_score += weight * score
        if len(self.places) < _MAX_PLACES:
            self.places.add(place)

    def absorb(self, other: Support) -> None:
        """Adds what another object, now found to be this one, had."""
        self.n += other.n
        self.near += other.near
        self.weight += other.weight
        self.weighted_score += other.weighted_score
        self.places = set(sorted(self.places | other.places, key=repr)[:_MAX_PLACES])
        both = {p: max(self.log_odds.get(p, -math.inf), other.log_odds.get(p, -math.inf)) for p in
                (*self.log_odds, *other.log_odds)}  # fmt: skip
        self.log_odds = dict(sorted(both.items(), key=lambda row: repr(row[0]))[:_MAX_PLACES])


#: Of a class that nobody detected.
NOTHING = Support()


#: Nothing that was seen once is surer than this.
_SUREST = 0.98


def log_odds(chance: float) -> float:
    """The logarithm of chance over its complement, of chances between 0.02 and 0.98."""
    p = min(_SUREST, max(1.0 - _SUREST, chance))
    return math.log(p / (1.0 - p))


def _support(
    n: int, near: int, weight: float, weighted_score: float, places: list[list[object]],
    odds: Sequence[tuple[list[object], float]] = (),
) -> Support:  # fmt: skip
    return Support(
        n, near, weight, weighted_score, {tuple(place) for place in places}, {tuple(place): o for place, o in odds}
    )


@dataclass(slots=True)
class Evidence:
    """All that was said about one object.

    Attributes:
        robot, surveillance: detections by class.
        misses: close robot views that should have shown its class and didn't.
        settled: the class that it was settled to be; empty before.
        flipped: the last change of that: from, to, and how often "to" had been seen then.
    """

    robot: dict[str, Support] = field(default_factory=dict)
    surveillance: dict[str, Support] = field(default_factory=dict)
    misses: int = 0
    settled: str = ""
    flipped: tuple[str, str, int] | None = None

    def state(self) -> dict[str, Any]:
        """All of it, as plain values, for ``of_state``."""
        kinds = {"robot": self.robot, "surveillance": self.surveillance}
        supports = {
            kind: {
                label: [
                    s.n,
                    s.near,
                    s.weight,
                    s.weighted_score,
                    sorted((list(p) for p in s.places), key=repr),
                    [[list(p), o] for p, o in sorted(s.log_odds.items(), key=lambda row: repr(row[0]))],
                ]
                for label, s in of_kind.items()
            }
            for kind, of_kind in kinds.items()
        }
        return {**supports, "misses": self.misses, "settled": self.settled, "flipped": self.flipped}

    @classmethod
    def of_state(cls, state: dict[str, Any]) -> Evidence:
        """The evidence that ``state`` was taken of."""
        robot, surveillance = (
            {label: _support(*fields) for label, fields in state[kind].items()} for kind in ("robot", "surveillance")
        )
        flipped = None
        if state["flipped"] is not None:
            old, new, then = state["flipped"]
            flipped = old, new, then
        return cls(robot, surveillance, state["misses"], state["settled"], flipped)

    def add(
        self, label: str, score: float, *, weight: float, near: bool, place: tuple[object, ...], is_robot: bool,
        chance: float | None = None,
    ) -> None:  # fmt: skip
        """One detection of a class. See ``Support.add``."""
        supports = self.robot if is_robot else self.surveillance
        supports.setdefault(label, Support()).add(score, weight, near, place, chance)

    def flip(self, label: str) -> None:
        """Settles on another class than before: a false positive, at least for now. What missed the old class is void."""
        self.flipped = self.settled, label, self.count(label)
        self.settled = label
        self.misses = 0

    def count(self, label: str) -> int:
        """Detections of a class by all sources."""
        return self.robot.get(label, NOTHING).n + self.surveillance.get(label, NOTHING).n

    def weight(self, label: str) -> float:
        """Their weight."""
        return self.robot.get(label, NOTHING).weight + self.surveillance.get(label, NOTHING).weight

    def absorb(self, other: Evidence) -> None:
        """Adds another object's."""
        for mine, theirs in ((self.robot, other.robot), (self.surveillance, other.surveillance)):
            for label, support in theirs.items():
                mine.setdefault(label, Support()).absorb(support)
        self.misses += other.misses
        self.settled = self.settled or other.settled
        self.flipped = self.flipped or other.flipped
