"""What views from one direction said about an object."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

#: From where an object was seen: "camera" and the camera's name, or "robot" and about from which side.
Direction = tuple[str, str]

_MAX_DIRECTIONS = 32  # more than a thing has sides and a floor has cameras that see it
_SUREST = 0.98  # nothing that was seen once is surer than this


@dataclass(slots=True)
class Look:
    """All views from one direction.

    Attributes:
        hits: by class, how many views called the object so.
        best: by class, the log-odds of the surest of them.
        misses: views that had the object in plain sight and called it nothing.
    """

    hits: dict[str, int] = field(default_factory=dict)
    best: dict[str, float] = field(default_factory=dict)
    misses: int = 0

    @property
    def named(self) -> int:
        """About how many views called the object anything: one may call it two things."""
        return max(self.hits.values(), default=0)

    def hit(self, label: str, odds: float, n: int = 1) -> None:
        """``n`` detections of a class, the surest of ``odds`` (``log_odds``)."""
        self.hits[label] = self.hits.get(label, 0) + n
        self.best[label] = max(odds, self.best.get(label, -math.inf))


@dataclass(slots=True)
class Looks:
    """The looks at one object, by direction."""

    of: dict[Direction, Look] = field(default_factory=dict)

    def __iter__(self) -> Iterator[tuple[Direction, Look]]:
        return iter(sorted(self.of.items()))

    def hit(self, direction: Direction, label: str, chance: float) -> None:
        """One detection of a class, right with a chance of 0-1."""
        if (look := self._at(direction)) is not None:
            look.hit(label, log_odds(chance))

    def miss(self, direction: Direction) -> None:
        """One view that should have shown the object and didn't."""
        if (look := self._at(direction)) is not None:
            look.misses += 1

    def absorb(self, other: Looks) -> None:
        """Adds what another object, now found to be this one, had."""
        for direction, more in other:
            if (look := self._at(direction)) is not None:
                look.misses += more.misses
                for label, n in more.hits.items():
                    look.hit(label, more.best[label], n)

    def _at(self, direction: Direction) -> Look | None:
        """None: there are too many directions already; what more of them show is no news."""
        if direction not in self.of and len(self.of) >= _MAX_DIRECTIONS:
            return None
        return self.of.setdefault(direction, Look())

    def state(self) -> list[Any]:
        """All of it as plain values, for ``from_state``."""
        return [[*direction, dict(look.hits), dict(look.best), look.misses] for direction, look in self]

    @classmethod
    def from_state(cls, rows: list[Any]) -> Looks:
        """The looks that ``state`` describes."""
        return cls({(str(kind), str(which)): Look(*fields) for kind, which, *fields in rows})


def of_kinds(looks: Looks, *kinds: str) -> Mapping[Direction, Look]:
    """Those of robots, of cameras, or of both."""
    return {direction: look for direction, look in looks if direction[0] in kinds}


def log_odds(chance: float) -> float:
    """The logarithm of chance over its complement, of chances between 0.02 and 0.98."""
    p = min(_SUREST, max(1.0 - _SUREST, chance))
    return math.log(p / (1.0 - p))
