"""What speaks for and against an object: detections by class and source, and looks that should have shown it."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

_MAX_PLACES = 16  # more different viewpoints than any rule asks for


@dataclass(slots=True)
class Support:
    """What one kind of source (robots, or surveillance) says for one class of one object.

    ``log_odds``: by the place that it was seen from, those of its best detection there.
    """

    n: int = 0
    near: int = 0
    weight: float = 0.0
    weighted_score: float = 0.0
    log_odds: dict[tuple[object, ...], float] = field(default_factory=dict)

    @property
    def places(self) -> Collection[tuple[object, ...]]:
        """From where it was seen."""
        return self.log_odds.keys()

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

    def absorb(self, other: Support) -> None:
        """Adds what another object, now found to be this one, had."""
        self.n += other.n
        self.near += other.near
        self.weight += other.weight
        self.weighted_score += other.weighted_score
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


def _fields(s: Support) -> list[Any]:
    places = sorted(s.places, key=repr)
    return [s.n, s.near, s.weight, s.weighted_score, [list(p) for p in places], [s.log_odds[p] for p in places]]


def _support(
    n: int, near: int, weight: float, weighted_score: float, places: list[list[object]], odds: Sequence[float] = ()
) -> Support:  # fmt: skip
    """What ``state`` wrote. States of before chances have no odds: even ones stand for them."""
    every = odds or [0.0] * len(places)
    return Support(n, near, weight, weighted_score, {tuple(p): o for p, o in zip(places, every, strict=True)})


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
        supports = {kind: {label: _fields(s) for label, s in of_kind.items()} for kind, of_kind in kinds.items()}
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
